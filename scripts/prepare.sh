# Sourced by `run` and `test`: one target folder outside the clone, a graphics adapter to draw with, and what else they need.

# A fresh clone finds what an older one built.
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-${XDG_CACHE_HOME:-$HOME/.cache}/fabrica/target}"

# Vulkan's loader complains on stderr without it.
if [ -z "${XDG_RUNTIME_DIR:-}" ]; then
    XDG_RUNTIME_DIR="${TMPDIR:-/tmp}/fabrica-runtime-$(id -u)"
    mkdir -p -m 700 "$XDG_RUNTIME_DIR"
    export XDG_RUNTIME_DIR
fi

# install WHAT PACKAGES HINT: installs Debian packages where that needs nobody's password, saying why; otherwise says what to
# install by hand.
install() {
    sudo=
    if [ "$(id -u)" != 0 ]; then
        if command -v sudo >/dev/null && sudo -n true 2>/dev/null; then sudo="sudo -n"; else sudo=no; fi
    fi
    if ! command -v apt-get >/dev/null || [ "$sudo" = no ]; then
        echo "$1. $3; on Debian and Ubuntu: sudo apt install $2" >&2
        return 1
    fi
    echo "$1: installing $2." >&2
    # shellcheck disable=SC2086 # several packages, perhaps no sudo
    if ! { $sudo apt-get update -qq && $sudo env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq $2; } >&2; then
        echo "apt-get could not install $2; install them by hand and try again." >&2
        return 1
    fi
}

# ensure_program NAME PACKAGE: a program that is on the path, installed where it is not.
ensure_program() {
    command -v "$1" >/dev/null && return 0
    install "There is no program $1" "$2" "Install it" || return 1
    command -v "$1" >/dev/null && return 0
    echo "There is still no program $1 after installing $2." >&2
    return 1
}

# ensure_window_libraries: what the window loads at run time (winit by way of x11-dl, x11rb and xkbcommon-dl), which no
# package of a bare system brings. Only glibc's cache is asked: where there is none, as on NixOS, or where nothing can be
# installed, the window itself says what it misses.
ensure_window_libraries() {
    [ "$(uname -s)" = Linux ] || return 0
    known=$(PATH="$PATH:/usr/sbin:/sbin" ldconfig -p 2>/dev/null) || return 0
    packages=
    for pair in libX11.so.6=libx11-6 libX11-xcb.so.1=libx11-xcb1 libXcursor.so.1=libxcursor1 libXi.so.6=libxi6 \
        libxcb.so.1=libxcb1 libxkbcommon.so.0=libxkbcommon0 libxkbcommon-x11.so.0=libxkbcommon-x11-0; do
        case "$known" in
            *"${pair%=*} "*) ;;
            *) packages="$packages ${pair#*=}" ;;
        esac
    done
    [ -n "$packages" ] || return 0
    install "The window's libraries are not all there" "${packages# }" "Install them" || true
}

# ensure_adapter PROGRAM ARGUMENTS…: runs the question; where its answer is no, installs Mesa's software driver and
# asks again. Only the program's answer counts: files of drivers prove nothing.
ensure_adapter() {
    "$@" >/dev/null 2>&1 && return 0
    if [ "$(uname -s)" != Linux ]; then
        echo "There is no graphics adapter; install a graphics driver." >&2
        return 1
    fi
    packages="mesa-vulkan-drivers libvulkan1"
    install "There is no graphics adapter" "$packages" \
        "Install one of your system's Vulkan drivers, for example Mesa's software driver" || return 1
    if ! "$@" >/dev/null 2>&1; then
        echo "There is still no graphics adapter after installing $packages:" >&2
        "$@" >&2
        return 1
    fi
}
