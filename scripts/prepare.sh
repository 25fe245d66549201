# Sourced by `run` and `test`: one target folder outside the clone, and a graphics adapter to draw with.

# A fresh clone finds what an older one built.
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-${XDG_CACHE_HOME:-$HOME/.cache}/fabrica/target}"

# Vulkan's loader complains on stderr without it.
if [ -z "${XDG_RUNTIME_DIR:-}" ]; then
    XDG_RUNTIME_DIR="${TMPDIR:-/tmp}/fabrica-runtime-$(id -u)"
    mkdir -p -m 700 "$XDG_RUNTIME_DIR"
    export XDG_RUNTIME_DIR
fi

# ensure_adapter PROGRAM ARGUMENTS…: runs the question; where its answer is no, installs Mesa's software driver and
# asks again. Only the program's answer counts: files of drivers prove nothing.
ensure_adapter() {
    "$@" >/dev/null 2>&1 && return 0
    if [ "$(uname -s)" != Linux ]; then
        echo "There is no graphics adapter; install a graphics driver." >&2
        return 1
    fi
    packages="mesa-vulkan-drivers libvulkan1"
    sudo=
    if [ "$(id -u)" != 0 ]; then
        if command -v sudo >/dev/null && sudo -n true 2>/dev/null; then sudo="sudo -n"; else sudo=no; fi
    fi
    if ! command -v apt-get >/dev/null || [ "$sudo" = no ]; then
        echo "There is no graphics adapter. Install one of your system's Vulkan drivers, for example Mesa's software" >&2
        echo "driver; on Debian and Ubuntu: sudo apt install $packages" >&2
        return 1
    fi
    echo "No graphics adapter: installing Mesa's software driver ($packages)." >&2
    if ! { $sudo apt-get update -qq && DEBIAN_FRONTEND=noninteractive $sudo apt-get install -y -qq $packages; } >&2; then
        echo "apt-get could not install $packages; install them by hand and try again." >&2
        return 1
    fi
    if ! "$@" >/dev/null 2>&1; then
        echo "There is still no graphics adapter after installing $packages:" >&2
        "$@" >&2
        return 1
    fi
}
