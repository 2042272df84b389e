#!/bin/bash
# palpate as a page of the manual calls it, made quick (run_blocks.py). From the environment:
#   PHANTOMS                 names of generated patients, as alternatives of a pattern
#   COARSE, FINER, FINEST    spacing=MM of a phantom's voxels
#   PALPATE_PROGRAM          the program
#   PALPATE_SHORT            a script that takes little time
#   PALPATE_KNOWN_RUNS       folder of the results of runs that several pages have
all=" $* "
arguments=()
for argument in "$@"; do
  if [[ $argument =~ ^($PHANTOMS)(:.*)?$ && $argument != *spacing=* && $all != *" --voxel "* && $all != " data fetch "* ]]; then
    # shellcheck disable=SC2153  # the variable of the environment, indeed
    coarse=$COARSE
    [[ $argument != skull-* ]] || coarse=$FINER
    [[ $argument != temporal-* ]] || coarse=$FINEST
    argument=$argument$([[ $argument == *:* ]] && echo , || echo :)$coarse
  fi
  # shellcheck disable=SC2001  # a pattern of characters up to a comma
  [[ $all != " data fetch "* ]] || argument=$(sed "s/spacing=[^,]*/$COARSE/" <<<"$argument")
  arguments+=("$argument")
done
case $all in
  " explore "*)
    [[ $all == *" --seconds "* ]] || arguments+=(--seconds 0.2)
    [[ $all == *" --port "* || $all == *" --no-viewer "* ]] || arguments+=(--port 0) ;;
  " simulate "*" --script "* | " simulate "*" -s "*) ;;
  " simulate "*)
    # the scenes of these files yield, which takes time
    [[ ! $2 =~ ^(scene.toml|study|STUDY|labels.nii.gz)$ ]] || arguments+=(--script "$PALPATE_SHORT") ;;
  " data fetch "*" --voxel "* | " data fetch "*:*) ;;
  " data fetch "*-phantom*) arguments+=(--voxel 2) ;;
esac
code=0
# a run of a generated patient by its name alone is the same on every page: what one of them made is copied
same="^ simulate ($PHANTOMS)[^ ]*( (-o|--report) [a-z0-9.-]+| --method [a-z-]+| --task [a-z-]+)* $"
known=
if [[ $all =~ $same ]]; then
  known=$PALPATE_KNOWN_RUNS/${all// /_}
  mkdir -p "$known"
  exec 9>"$known.lock"
  flock 9
fi
if [[ -e $known/code ]]; then
  cp -r "$known/files/." .
  cat "$known/err" >&2
  cat "$known/out"
  code=$(<"$known/code")
elif [[ $known ]]; then
  "$PALPATE_PROGRAM" "${arguments[@]}" >"$known/out" 2>"$known/err" 9>&- || code=$?
  cat "$known/err" >&2
  cat "$known/out"
  mkdir -p "$known/files"
  for ((n = 1; n < $#; ++n)); do
    [[ ! ${!n} =~ ^(-o|--report)$ ]] || { next=$((n + 1)); [[ ! -e ${!next} ]] || cp "${!next}" "$known/files/"; }
  done
  echo "$code" >"$known/code"
elif [[ $all == *" --view "* ]]; then
  timeout --signal=INT 1 "$PALPATE_PROGRAM" "${arguments[@]}" --port 0 || code=$?
  # ended from outside, as by Ctrl-C
  ((code != 124 && code != 130)) || code=0
else
  "$PALPATE_PROGRAM" "${arguments[@]}" || code=$?
fi
# what doctor finds missing is its result
[[ $all != " doctor "* || $code != 1 ]] || code=0
exit $((code == 3 ? 0 : code))
