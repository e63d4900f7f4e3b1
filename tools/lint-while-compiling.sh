#!/usr/bin/env bash
# A compiler for `RUSTC_WRAPPER` of `./test`: compiles a crate, and lints it if it is one that was asked for. `cargo clippy` compiles the interfaces of all 600
# dependencies beside what a build compiles, for minutes on a cold machine; here clippy reads those of the build. What is up to date is not
# linted again, and clippy does not see tests that are files of their own, nor examples: a warm tree needs `cargo xtask check`.
#
#   RUSTC_WRAPPER="$PWD/tools/lint-while-compiling.sh" cargo build --release --workspace
set -euo pipefail
rustc=$1
shift

# Dependencies, build scripts, and questions such as `rustc -vV`.
case "${CARGO_PRIMARY_PACKAGE:-} ${CARGO_CRATE_NAME:-}" in
  " "* | "1 " | *" build_script_"*) exec "$rustc" "$@" ;;
esac
# What tests is optimised less: the unit tests of a library are all of the library once more, and to optimise them as a program is takes longer than they run;
# what is compiled for a short build anyhow (`opt-level = 1` in Cargo.toml), such as the server, is not optimised at all: its unit tests took 200 s, now 80, and run for one.
# The twin's other tests call it, and compute nothing themselves.
quick=(-C opt-level=1 -C codegen-units=16)
case " $* " in
  *" opt-level=1 "*) quick=(-C opt-level=0 -C codegen-units=16) ;;
esac
case "$CARGO_PKG_NAME $* " in
  *"/lib.rs "*" --test "*)
    "$rustc" "$@" "${quick[@]}" || exit
    ;;
  *"/lib.rs "*" --crate-type lib "*)
    # Its lints come with its unit tests; what only those use is a warning here.
    exec "$rustc" "$@" -D warnings
    ;;
  # Over a hundred small programs, each with the interfaces of all that it calls: the compiler's own lints are enough here.
  "rotortwin-twin "*" --test "* | "rotortwin-tests "*" --test "*) exec "$rustc" "$@" "${quick[@]}" -D warnings ;;
  *" --test "* | *" examples/"* | *"/examples/"*) exec "$rustc" "$@" -D warnings ;;
  *) "$rustc" "$@" || exit ;;
esac

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
# The same call, for its interface alone and for people: cargo takes JSON for its own.
arguments=()
skip=
for argument in "$@"; do
  if [ -n "$skip" ]; then
    skip=
    continue
  fi
  case $argument in
    --out-dir) skip=1 ;;
    --emit=* | --json=* | --error-format=* | --out-dir=*) ;;
    *) arguments+=("$argument") ;;
  esac
done
CLIPPY_ARGS="-D__CLIPPY_HACKERY__warnings__CLIPPY_HACKERY__" clippy-driver "$rustc" "${arguments[@]}" --emit=metadata --out-dir "$scratch"
