"""Imports every module of the installed muybridge and says which do not import.

Modules that need an extra that is not installed (`muybridge.train` needs torch) may fail for that reason and
no other. Prints one line a failure and exits with 1 if there is any.
"""

import importlib
import pkgutil
import sys
import traceback

import muybridge

# What the extras bring and the base install does not.
EXTRAS = {"torch", "kornia", "anny", "moderngl", "onnx", "onnxscript"}


def main() -> int:
    """Import everything; the number of modules that failed for another reason than a missing extra."""
    names = [m.name for m in pkgutil.walk_packages(muybridge.__path__, "muybridge.")]
    failed = missing = 0
    for name in names:
        if name.endswith("__main__"):
            continue
        try:
            importlib.import_module(name)
        except ModuleNotFoundError as error:
            if (error.name or "").split(".")[0] in EXTRAS:
                missing += 1
                continue
            failed += 1
            traceback.print_exc()
        except Exception:
            failed += 1
            traceback.print_exc()
    print(f"{len(names)} modules, {missing} left out for want of an extra, {failed} failed")
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
