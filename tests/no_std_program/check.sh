#!/usr/bin/env bash
# Builds the bare-metal programs and looks at what they need from outside: no allocator, no standard library, no unwinding.
# The programs `estimator` and `standalone` do not even link when a path to a panic remains in it.
set -euo pipefail
cd "$(dirname "$0")"
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-../../target}/no_std"
# The workspace's versions; cargo drops what these programs do not need.
cp ../../Cargo.lock Cargo.lock
cargo build --release --quiet
for program in estimator standalone controller_parts; do
    needed=$(nm --undefined-only "$CARGO_TARGET_DIR/release/$program" | awk '{ sub(/@.*/, "", $NF); print $NF }')
    for symbol in $needed; do
        case "$symbol" in
        memcpy | memmove | memset | memcmp | bcmp) ;;
        *)
            echo "$program needs \`$symbol\` from outside, which a program without the standard library must not" >&2
            exit 1
            ;;
        esac
    done
    if nm "$CARGO_TARGET_DIR/release/$program" | grep -E '__rust_(alloc|dealloc|realloc)|_Unwind_|std::' >&2; then
        echo "$program contains an allocator, unwinding or the standard library (above)" >&2
        exit 1
    fi
    # The generated estimator has no path to a panic, so that nothing of the panic machinery is in the program.
    if [ "$program" != controller_parts ] && nm "$CARGO_TARGET_DIR/release/$program" | grep -E 'panicking|panic_fmt' >&2; then
        echo "$program refers to the panic machinery (above)" >&2
        exit 1
    fi
    echo "$program: needs only $(echo $needed | tr '\n' ' ')"
done
