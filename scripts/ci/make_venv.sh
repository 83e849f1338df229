#!/usr/bin/env bash
# Makes a virtual environment with the first Python on the PATH that is 3.11 or newer.
set -euo pipefail
venv=${1:?usage: make_venv.sh FOLDER}

# Each is run, not only looked up: a version manager's shim may exist for a Python that does not.
for candidate in python3.11 python3.12 python3.13 python3 python; do
    if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then
        python=$candidate
        break
    fi
done
if [ -z "${python:-}" ]; then
    echo "muybridge needs Python 3.11 or newer and none is on the PATH ($(python3 --version 2>&1 || true))." >&2
    echo "Install one (Debian, Ubuntu: apt install python3.11 python3.11-venv), then run make again." >&2
    exit 1
fi
if ! "$python" -c 'import ensurepip, venv' >/dev/null 2>&1; then
    echo "$("$python" --version) has no venv module." >&2
    echo "Install it (Debian, Ubuntu: apt install $("$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')), then run make again." >&2
    exit 1
fi
echo "Making $venv with $("$python" --version)"
"$python" -m venv "$venv"
