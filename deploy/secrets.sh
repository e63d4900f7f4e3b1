#!/bin/sh
# Makes what docker-compose.yml reads from deploy/secrets: passwords, certificates of zenoh, and who may do what over it.
# What is there already stays. The folder is for your eyes only; the files in it are readable, since the processes in the containers
# have another user id. HOSTS: more names or addresses by which other hosts reach the router and the API, separated by commas.
#
#   deploy/secrets.sh [HOSTS]
set -eu
cd "$(dirname "$0")"
umask 077
mkdir -p secrets
chmod 700 secrets
word() { head -c 24 /dev/urandom | base64 | tr -d '+/=\n'; }
[ -e secrets/postgres-password ] || word > secrets/postgres-password
[ -e secrets/database-url ] || printf 'postgres://rotortwin:%s@postgres/rotortwin' "$(cat secrets/postgres-password)" > secrets/database-url
./certificates.sh secrets "router,localhost,127.0.0.1${1:+,$1}" "api,localhost,127.0.0.1${1:+,$1}" plant controller fdi
chmod 644 secrets/*
chmod 600 secrets/ca-key.pem
