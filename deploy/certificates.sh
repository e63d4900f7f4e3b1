#!/bin/sh
# Makes certificates for zenoh over TLS: an authority of your own (once), and one certificate for each name that is given.
#
#   deploy/certificates.sh FOLDER NAME[,HOST,…] …
#
# A NAME becomes the common name, by which access control knows its owner; HOSTs (names or IPv4 addresses) are where others reach
# it, needed for whoever listens. FOLDER/ca.pem goes to every host; NAME.pem and NAME-key.pem to their owner only; ca-key.pem to
# nobody. What is there already stays. Needs openssl 3.
set -eu
umask 077
[ $# -ge 2 ] || { echo "certificates.sh: expected FOLDER NAME[,HOST,...] ..." >&2; exit 2; }
folder=$1
shift
mkdir -p "$folder"
cd "$folder"
days=825
key() { openssl genpkey -quiet -algorithm EC -pkeyopt ec_paramgen_curve:P-256 -out "$1" 2>/dev/null ||
        openssl genpkey -algorithm EC -pkeyopt ec_paramgen_curve:P-256 -out "$1" 2>/dev/null; }
if [ ! -e ca-key.pem ]; then
  key ca-key.pem
  openssl req -x509 -new -key ca-key.pem -sha256 -days 3650 -subj '/CN=rotortwin authority' \
    -addext 'basicConstraints=critical,CA:TRUE' -addext 'keyUsage=critical,keyCertSign,cRLSign' -out ca.pem
fi
for entry in "$@"; do
  name=${entry%%,*}
  case $name in '' | *[!A-Za-z0-9._-]*) echo "certificates.sh: the name '$name' has other characters than A-Z a-z 0-9 . _ -" >&2; exit 2 ;; esac
  [ ! -e "$name.pem" ] || continue
  hosts=$(printf '%s' "$entry" | tr ',' '\n' | sed 1d)
  names="DNS:$name"
  for host in $hosts; do
    case $host in *[!0-9.]*) names="$names,DNS:$host" ;; *) names="$names,IP:$host" ;; esac
  done
  key "$name-key.pem"
  printf 'basicConstraints=critical,CA:FALSE\nkeyUsage=critical,digitalSignature\nextendedKeyUsage=serverAuth,clientAuth\nsubjectAltName=%s\n' \
    "$names" > "$name.ext"
  openssl req -new -key "$name-key.pem" -subj "/CN=$name" |
    openssl x509 -req -in /dev/stdin -CA ca.pem -CAkey ca-key.pem -CAcreateserial -sha256 -days $days -extfile "$name.ext" \
      -out "$name.pem" 2>/dev/null
  rm "$name.ext"
done
chmod 644 ./*.pem
chmod 600 ./*-key.pem
