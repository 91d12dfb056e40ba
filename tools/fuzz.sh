#!/usr/bin/env bash
# tools/fuzz.sh RUNS TARGET...: coverage-guided fuzzing (docs/fuzzing.md). A log for each target, fuzz/work/TARGET.log; inputs that were
# found to fail lie in fuzz/artifacts/TARGET.
set -euo pipefail
cd "$(dirname "$0")/.."

runs=$1
shift

if ! cargo +nightly --version >/dev/null 2>&1 || ! cargo fuzz --version >/dev/null 2>&1; then
    echo "fuzzing needs a nightly compiler and cargo-fuzz:" >&2
    echo "  rustup toolchain install nightly && cargo install --locked cargo-fuzz" >&2
    exit 2
fi

# As .cargo/config.toml, which flags of the environment replace. Without a sanitizer: the library has no unsafe code, and is twice as fast.
export RUSTFLAGS="-C target-cpu=x86-64-v2"
cargo +nightly fuzz build --sanitizer none --codegen-units 16
programs=fuzz/target/$(rustc +nightly -vV | sed -n 's/^host: //p')/release

# Inputs are files for the program, too; they need no disk.
if [ -z "${TMPDIR:-}" ] && [ -w /dev/shm ]; then export TMPDIR=/dev/shm; fi
TMPDIR=$(mktemp -d)
export TMPDIR
trap 'rm -rf "$TMPDIR"' EXIT
# One thread for each process: inputs are small.
export RAYON_NUM_THREADS=1

"$programs/seeds" fuzz/work/seeds
failed=
for target in "$@"; do
    mkdir -p "fuzz/work/$target" "fuzz/artifacts/$target"
    echo "fuzzing $target: $runs inputs, fuzz/work/$target.log"
    nice -n 10 "$programs/$target" -runs="$runs" -max_len=20000 -timeout=10 -rss_limit_mb=2048 -print_final_stats=1 \
        -artifact_prefix="fuzz/artifacts/$target/" -dict=fuzz/words.dict "fuzz/work/$target" "fuzz/corpus/$target" \
        "fuzz/work/seeds/$target" >"fuzz/work/$target.log" 2>&1 || failed+=" $target"
    grep -E "^stat::number|^stat::average|DONE" "fuzz/work/$target.log" || true
done
if [ -n "$failed" ]; then
    echo "inputs that fail lie in fuzz/artifacts:$failed" >&2
    exit 1
fi
