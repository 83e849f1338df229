#!/usr/bin/env bash
# Sees to it that synthetic people can be rendered: a windowless OpenGL context through EGL.
set -euo pipefail
python=${1:?usage: ensure_egl.sh PYTHON}
packages="libegl1 libgl1 libegl-mesa0 libgl1-mesa-dri"

renders() {
    "$python" - <<'PY' >/dev/null 2>&1
import moderngl

moderngl.create_context(standalone=True, backend="egl", libgl="libGL.so.1", libegl="libEGL.so.1").release()
PY
}

renders && exit 0
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "Installing the EGL libraries for rendering: $packages"
    apt-get update -qq
    # shellcheck disable=SC2086
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $packages >/dev/null
    renders && exit 0
    echo "EGL still gives no OpenGL context after installing $packages: synthetic people cannot be rendered." >&2
    exit 1
fi
echo "Rendering synthetic people needs EGL, and the libraries are missing or do not work." >&2
echo "Install them (Debian, Ubuntu: sudo apt install $packages), then run make again." >&2
exit 1
