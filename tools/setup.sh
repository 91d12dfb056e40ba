#!/usr/bin/env bash
# Prepares a machine for cloudparity; `make setup` calls it. Nothing is installed that is there already.
#
#   tools/setup.sh system   the Rust compiler (checked), system libraries (installed by root on Debian)
#   tools/setup.sh python   .venv with the packages of requirements.txt and requirements-dev.txt, and the newest release
#                           of Blender in an environment of its own where an interpreter for it is there
#   tools/setup.sh sweep    .venv-sweep with those of requirements-sweep.txt, on demand: for sweeps beyond one machine
#
# PYTHON=/path/to/python3.11 chooses the interpreter that .venv is made with, CLOUDPARITY_PYTHON_3_13=/path/to/python3.13
# that of the newest release, and CLOUDPARITY_CACHE the folder that holds its environment.
set -euo pipefail
cd "$(dirname "$0")/.."

# Shared libraries that bpy is linked against, and the loader and software driver that wgpu needs where
# there is no GPU; the second row opens the window. gcc links Rust programs.
LIBRARIES=(libx11-6 libxext6 libxrender1 libxfixes3 libxi6 libxkbcommon0 libsm6 libice6 libgl1
    libx11-xcb1 libxcursor1 libxkbcommon-x11-0 libvulkan1 mesa-vulkan-drivers gcc libc6-dev)

say() { printf 'setup: %s\n' "$*" >&2; }

fail() {
    say "$1"
    shift
    printf '       %s\n' "$@" >&2
    exit 1
}

check_rust() {
    local required found
    required=$(sed -n 's/^rust-version = "\(.*\)"$/\1/p' Cargo.toml)
    if ! found=$(rustc --version 2>/dev/null); then
        fail "rustc is missing; Rust $required or later is needed. Install it with" \
            "curl --proto '=https' --tlsv1.2 -sSf https://sh.rustup.rs | sh -s -- -y"
    fi
    found=$(cut -d' ' -f2 <<<"$found")
    if ! printf '%s\n' "$required" "${found%%-*}" | sort -C -V; then
        if command -v rustup >/dev/null; then
            fail "rustc is $found; Rust $required or later is needed:" "rustup update stable && rustup default stable"
        fi
        fail "rustc is $found; Rust $required or later is needed. A distribution's own package is often older:" \
            "curl --proto '=https' --tlsv1.2 -sSf https://sh.rustup.rs | sh -s -- -y"
    fi
}

is_cpython_311() {
    "$1" -c 'import sys; sys.exit((sys.implementation.name, *sys.version_info[:2]) != ("cpython", 3, 11))' 2>/dev/null
}

can_make_environments() {
    "$1" -c 'import ensurepip, venv' 2>/dev/null
}

# Prints the interpreter to make .venv with: one that has ensurepip where there is one.
find_python() {
    local name without_ensurepip=
    for name in ${PYTHON:-python3.11 python3 /usr/bin/python3.11 /usr/bin/python3}; do
        if is_cpython_311 "$name"; then
            if can_make_environments "$name"; then
                printf '%s\n' "$name"
                return
            fi
            without_ensurepip=$name
        fi
    done
    printf '%s\n' "$without_ensurepip"
}

is_installed() {
    [[ $(dpkg-query --show --showformat='${db:Status-Status}' "$1" 2>/dev/null) == installed ]]
}

install_packages() {
    local package python wanted=("${LIBRARIES[@]}") missing=() command
    if ! command -v apt-get >/dev/null; then
        return # Another system: `cloudparity doctor` says what is missing.
    fi
    python=$(find_python)
    if [[ -z $python ]] || ! can_make_environments "$python"; then
        wanted+=(python3 python3-venv)
    fi
    for package in "${wanted[@]}"; do
        is_installed "$package" || missing+=("$package")
    done
    if ((${#missing[@]} == 0)); then
        return
    fi
    command="apt-get update && apt-get install --yes --no-install-recommends ${missing[*]}"
    if [[ $(id --user) -ne 0 ]]; then
        say "system packages are missing: ${missing[*]}"
        say "as root: $command"
    elif say "installing ${missing[*]}" && ! DEBIAN_FRONTEND=noninteractive bash -c "$command" >&2; then
        say "could not install them; what needs them is left out. As root: $command"
    fi
}

make_environment() {
    local python
    if [[ -x .venv/bin/python ]] && ! is_cpython_311 .venv/bin/python; then
        fail "the interpreter of .venv is not CPython 3.11. Remove the folder and run make setup again:" "rm -r .venv"
    fi
    if ! .venv/bin/python -m pip --version >/dev/null 2>&1; then
        python=$(find_python)
        if [[ -z $python ]]; then
            fail "CPython 3.11 is missing; bpy 5.0.1 exists for no other version. One of:" \
                "apt-get install python3 python3-venv    (Debian 12, as root)" \
                "uv python install 3.11 && make setup PYTHON=\"\$(uv python find 3.11)\"" \
                "pyenv install 3.11 && make setup PYTHON=\"\$(pyenv prefix 3.11)/bin/python\""
        fi
        if ! can_make_environments "$python"; then
            fail "$python has no ensurepip. As root:" "apt-get install python3-venv"
        fi
        say "making .venv with $("$python" --version)"
        "$python" -m venv .venv
    fi
    say "installing the packages of requirements.txt and requirements-dev.txt (about 400 MB to download)"
    .venv/bin/python -m pip install --quiet --disable-pip-version-check \
        --requirement requirements.txt --requirement requirements-dev.txt
}

# What .venv has is what all records and tests are of. Newer releases, whose wheels are for CPython 3.13, have the
# environment that the program makes, too, and where the program looks for it (src/bridge/releases.rs).
NEWEST=5.3.0

# Prints a CPython 3.13 that makes environments; the order is that of src/bridge/interpreter.rs.
find_python_of_newest() {
    local name
    for name in ${CLOUDPARITY_PYTHON_3_13:-python3.13 python3 "$(uv python find --no-python-downloads 3.13 2>/dev/null)" \
        "${PYENV_ROOT:-$HOME/.pyenv}"/versions/3.13.*/bin/python3.13}; do
        if "$name" -c 'import ensurepip, sys, venv
sys.exit((sys.implementation.name, *sys.version_info[:2]) != ("cpython", 3, 13))' 2>/dev/null; then
            printf '%s\n' "$name"
            return
        fi
    done
}

make_environment_of_newest() {
    local python folder=${CLOUDPARITY_CACHE:-$HOME/.cache/cloudparity}/blender/$NEWEST
    if [[ -e $folder/complete ]]; then
        return
    fi
    python=$(find_python_of_newest)
    if [[ -z $python ]]; then
        say "CPython 3.13 is not there; it would bring Blender 5.1 to $NEWEST: files that these saved, and --blender 5.3. One of:" \
            "uv python install 3.13, pyenv install 3.13, CLOUDPARITY_PYTHON_3_13=/path/to/python3.13; then make setup again"
        return
    fi
    say "making the environment of Blender $NEWEST with $("$python" --version) (about 400 MB to download)"
    rm -rf "$folder"
    if ! "$python" -m venv "$folder" || ! "$folder/bin/python" -m pip install --quiet --disable-pip-version-check \
        "bpy==$NEWEST" --requirement requirements-releases.txt $(grep -E '^pytest(-xdist)?==' requirements-dev.txt); then
        say "Blender $NEWEST could not be installed; what needs it makes the environment when it is first asked for"
        return
    fi
    printf '%s' "$NEWEST" >"$folder/complete"
}

make_sweep_environment() {
    local python stamp=.venv-sweep/requirements.stamp
    if [[ -e $stamp && ! requirements-sweep.txt -nt $stamp ]]; then
        return
    fi
    python=$(find_python)
    if [[ -z $python ]] || ! can_make_environments "$python"; then
        fail "CPython 3.11 with ensurepip is missing (snakemake 9 needs 3.11). As root:" \
            "apt-get install python3 python3-venv"
    fi
    say "making .venv-sweep with $("$python" --version)"
    "$python" -m venv .venv-sweep
    .venv-sweep/bin/python -m pip install --quiet --disable-pip-version-check --requirement requirements-sweep.txt
    touch "$stamp"
}

case ${1:-} in
system)
    check_rust
    install_packages
    ;;
python)
    make_environment
    make_environment_of_newest
    ;;
sweep) make_sweep_environment ;;
*) fail "unknown step \"${1:-}\"; one of:" "system" "python" "sweep" ;;
esac
