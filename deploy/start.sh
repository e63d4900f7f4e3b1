#!/bin/sh
# Start of a container: what `rotortwin` takes from its environment may stand in files.
#
# DATABASE_URL_FILE  file that holds DATABASE_URL
# FIRST_TOKEN_FILE   `serve` on a database without a valid token writes one of all scopes here, readable by its owner only
set -eu
if [ -n "${DATABASE_URL_FILE:-}" ]; then
  DATABASE_URL=$(cat "$DATABASE_URL_FILE")
  export DATABASE_URL
fi
if [ "${1:-}" = serve ] && [ -n "${FIRST_TOKEN_FILE:-}" ]; then
  # Without a database there is no token.
  if { [ -z "${DATABASE_URL:-}" ] && [ ! -e /data/rotortwin.sqlite ]; } || ! rotortwin token --data /data list | grep -qw valid; then
    (umask 077 && rotortwin token --data /data create first --scopes read,write,admin > "$FIRST_TOKEN_FILE")
  fi
fi
exec rotortwin "$@"
