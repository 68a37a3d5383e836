#!/bin/sh
# Prepare a virtual environment with everything the project needs. Nothing is installed globally,
# except a graphics library when run as root on a Debian-like system that lacks one.
#
#   deploy/setup.sh <venv directory>
#
# PYTHON=<path> chooses the interpreter.
set -eu
venv=$1
root=$(cd "$(dirname "$0")/.." && pwd)
extras=sim,wbc,policy,teleop,headset,logger,deploy,dev

fits='import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 12))'
find_python() {
    for candidate in ${PYTHON:-python3.12 python3.11 python3 python}; do
        if "$candidate" -c "$fits" >/dev/null 2>&1; then
            echo "$candidate"
            return 0
        fi
    done
    return 1
}

if ! python=$(find_python); then
    cat >&2 <<'MESSAGE'
setup: no Python 3.11 or 3.12 found (tried python3.12, python3.11, python3, python).
Install one, e.g. on Debian or Ubuntu:  apt-get install python3.11 python3.11-venv
on Fedora:  dnf install python3.12       with pyenv:  pyenv install 3.12
or name one:  make PYTHON=/path/to/python3.12 demo
MESSAGE
    exit 1
fi

if [ ! -x "$venv/bin/python" ] || ! "$venv/bin/python" -c "$fits" >/dev/null 2>&1; then
    echo "setup: creating $venv with $("$python" --version)"
    if ! "$python" -c 'import venv, ensurepip' >/dev/null 2>&1; then
        echo "setup: $python lacks the venv module." >&2
        echo "Install it, e.g. on Debian or Ubuntu:  apt-get install python3-venv" >&2
        exit 1
    fi
    "$python" -m venv --clear "$venv"
fi

echo "setup: installing the packages into $venv (once; takes a few minutes)"
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check -e "$root[$extras]" || {
    echo "setup: pip could not install the packages; see above. Is the package index reachable?" >&2
    exit 1
}
"$venv/bin/trill" --version

has_gl='import ctypes.util as u, sys
sys.exit(not (u.find_library("EGL") and (u.find_library("GL") or u.find_library("OpenGL"))))'
if [ "$(uname)" = Linux ] && ! "$venv/bin/python" -c "$has_gl"; then
    packages="libegl1 libgl1 libgl1-mesa-dri"
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        echo "setup: installing a graphics library ($packages)"
        { apt-get update -qq && DEBIAN_FRONTEND=noninteractive \
            apt-get install -y -qq --no-install-recommends $packages >/dev/null; } || true
    fi
    if ! "$venv/bin/python" -c "$has_gl"; then
        echo "setup: no EGL library: everything runs, but without cameras, pictures and videos." >&2
        echo "To have them, on Debian or Ubuntu:  apt-get install $packages" >&2
    fi
fi
touch "$venv/.installed"
