# Sourced by ./run and ./test: makes sure that cargo and a C compiler are there, or stops with one sentence.
# Expects a function `stop SENTENCE [EXIT_CODE]`.

[ -n "$(command -v cargo)" ] || { [ -e "$HOME/.cargo/env" ] && . "$HOME/.cargo/env"; } || true
[ -n "$(command -v cargo)" ] || stop "cargo is missing: install Rust with rustup (https://rustup.rs), then start again"

# zstd, SQLite and ring are C, and every Rust program is linked by cc.
if [ -z "$(command -v cc)" ]; then
  if [ -n "$(command -v apt-get)" ]; then
    as_root=; [ "$(id -u)" = 0 ] || as_root=sudo
    [ -z "$as_root" ] || [ -n "$(command -v sudo)" ] || stop "a C compiler is missing and you are not root: install gcc, then start again"
    echo "Installing gcc ..."
    { $as_root apt-get update -qq && $as_root apt-get install -y -qq --no-install-recommends gcc libc6-dev; } > /dev/null \
      || stop "gcc could not be installed with apt-get: install it, then start again"
  else
    stop "a C compiler is missing: install gcc or clang, then start again"
  fi
fi
