#!/usr/bin/env bash
# Makes sure that this machine can build for the Pixhawk's processor (thumbv7em-none-eabihf).
#
#   usage: tools/thumb-toolchain.sh
#
# Prints, as its only line on standard output, the argument that cargo needs: "+deb" or nothing. So:
#
#   cargo $(tools/thumb-toolchain.sh) build --target thumbv7em-none-eabihf ...
#
# A rustup that has the target is used as it is: nothing is changed. Where it has not, and apt is at hand, this installs
# Debian's rustc-web with its sources, builds core and alloc for the target once into its sysroot, and links it as the
# rustup toolchain "deb"; from then on every build is a plain stable one. Running it again only verifies.
# Words for people go to standard error; on failure it is one sentence, and the exit status is 1.
set -euo pipefail

target=thumbv7em-none-eabihf
packages=(rustc-web rust-web-src rust-web-clippy lld-22)

stop() { echo "thumb-toolchain: $1" >&2; exit 1; }

# A toolchain (name, or nothing for the active one) serves if its sysroot has core for the target and its rustc accepts
# that. Asks rustup, not PATH: Debian's rustc may stand on the path as well.
serves() {
  local rustc scratch status=0
  rustc=$(rustup which ${1:+--toolchain "$1"} rustc 2> /dev/null) || return 1
  compgen -G "$("$rustc" --print sysroot)/lib/rustlib/$target/lib/libcore-*.rlib" > /dev/null || return 1
  scratch=$(mktemp -d)
  echo '#![no_std]' > "$scratch/probe.rs"
  "$rustc" --edition 2024 --crate-type rlib --target "$target" --out-dir "$scratch" "$scratch/probe.rs" \
    > /dev/null 2>&1 || status=1
  rm -rf "$scratch"
  return $status
}

[ -n "$(command -v rustup)" ] || stop "rustup is missing: install Rust with rustup (https://rustup.rs), then start again"
if serves ""; then exit 0; fi
if serves deb; then echo "+deb"; exit 0; fi

[ -n "$(command -v apt-get)" ] \
  || stop "the target $target is missing: run 'rustup target add $target', then start again"
as_root=()
if [ "$(id -u)" != 0 ]; then
  [ -n "$(command -v sudo)" ] || stop "installing ${packages[*]} needs root: run this as root once"
  as_root=(sudo)
fi

missing=()
for package in "${packages[@]}"; do
  dpkg-query -W -f '${db:Status-Status}' "$package" 2> /dev/null | grep -qx installed || missing+=("$package")
done
if [ ${#missing[@]} -gt 0 ]; then
  echo "Installing ${missing[*]} ..." >&2
  { "${as_root[@]}" apt-get update -qq \
      && "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
           apt-get install -y -qq --no-install-recommends "${missing[@]}"; } > /dev/null 2>&1 \
    || stop "apt-get could not install ${missing[*]}: install them, or run 'rustup target add $target', then start again"
fi

prefix=$(dpkg -L rustc-web | sed -n 's,/bin/rustc$,,p' | head -n 1)
[ -n "$prefix" ] || stop "the package rustc-web brings no bin/rustc"
rustup toolchain link deb "$prefix" > /dev/null 2>&1 || stop "rustup could not link $prefix as the toolchain \"deb\""

library=$("$prefix/bin/rustc" --print sysroot)/lib/rustlib/$target/lib
version=$("$prefix/bin/rustc" --version | cut -d ' ' -f 2)
# The stamp carries the version: another compiler refuses the libraries.
if [ ! -e "$library/.$version" ]; then
  echo "Building core and alloc for $target (about a minute) ..." >&2
  scratch=$(mktemp -d)
  trap 'rm -rf "$scratch"' EXIT
  mkdir "$scratch/src"
  echo '#![no_std]' > "$scratch/src/lib.rs"
  printf '[package]\nname = "thumb-std"\nedition = "2024"\n[workspace]\n' > "$scratch/Cargo.toml"
  # Bitcode is what lets link-time optimisation reach into these libraries.
  ( cd "$scratch" \
      && env -u CARGO -u RUSTC -u RUSTUP_TOOLCHAIN -u CARGO_TARGET_DIR RUSTC_BOOTSTRAP=1 RUSTFLAGS=-Cembed-bitcode=yes \
           cargo +deb build -q -j 2 --release -Zbuild-std=core,alloc --target "$target" > log 2>&1 ) \
    || { tail -n 5 "$scratch/log" >&2; stop "core could not be built for $target with Debian's rustc $version"; }
  "${as_root[@]}" rm -rf "$library"
  "${as_root[@]}" install -d "$library"
  "${as_root[@]}" install -m 644 \
    "$scratch/target/$target/release/deps"/lib{core,alloc,compiler_builtins}-*.rlib "$library"
  "${as_root[@]}" touch "$library/.$version"
fi

serves deb || stop "the toolchain \"deb\" does not build for $target although its libraries are in $library"
echo "+deb"
