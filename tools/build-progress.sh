# Sourced by ./run: how far a build is, of what cargo draws while it compiles.
#
# cargo numbers its units (a package, a build script, a program): "Building [==>   ] 150/431: zenoh, parquet". A unit of ours takes about as long
# as ten of others (measured with tools/cold-start.sh: 23 s against 2.4 s), and the last ones are ours: the time that is left is told by units
# of that weight.

# Units of ours that the program PROGRAM is made of.
#   own_units PACKAGE
own_units() {
  cargo tree --locked --package "$1" --edges normal,build --prefix none --no-dedupe 2> /dev/null | grep -o '^rotortwin[a-z-]*' | sort -u | wc -l
}

# Units that are done, and all of them, as "DONE ALL"; nothing before cargo has counted them.
#   units LOG
units() {
  tr '\r' '\n' < "$1" | sed -n 's/^ *Building \[[^]]*\] \([0-9]*\)\/\([0-9]*\).*/\1 \2/p' | tail -n 1
}

# One line for people: "  150 of 431 units, about 4 min left: zenoh, parquet"; nothing before cargo has counted.
#   build_progress LOG SECONDS FRESH OWN
# SECONDS  since the build began
# FRESH    units that were there before (those of the other program)
# OWN      units of ours among all
build_progress() {
  local counted done all names begun running own weight whole left
  counted=$(units "$1")
  [ -n "$counted" ] || return 0
  done=${counted% *} all=${counted#* }
  names=$(tr '\r' '\n' < "$1" | sed -n 's/^ *Building \[[^]]*\] [0-9]*\/[0-9]*: *\(.*[^ ]\) *$/\1/p' | tail -n 1)
  begun=$(tr '\r' '\n' < "$1" | grep -o '^ *Compiling rotortwin[a-z-]*' | sort -u | wc -l)
  running=$(printf '%s\n' "$names" | grep -o 'rotortwin[a-z-]*' | sort -u | wc -l)
  own=$((begun > running ? begun - running : 0))
  weight=$((done - $3 + 9 * own))
  whole=$((all - $3 + 9 * $4))
  printf '  %s of %s units' "$done" "$all"
  # The first ones say nothing about the rest.
  if [ "$weight" -ge 20 ] && [ "$whole" -gt "$weight" ]; then
    left=$(($2 * (whole - weight) / weight))
    if [ "$left" -lt 60 ]; then printf ', less than a minute left'; else printf ', about %s min left' $(((left + 30) / 60)); fi
  fi
  [ -z "$names" ] || printf ': %s' "$names"
  printf '\n'
}
