#!/usr/bin/env bash
# Ray casts the simulated scans that trainer/configs/translation asks for:
#   scripts/translation-data.sh DATA MESH        with realbeam-trainer on the path; about a minute
# MESH is Delft as CityJSON; its scans are taken in streets, those to test on north of those to learn from. The real scans, KITTI's as .bin,
# are the user's to put under DATA/kitti (trainer/configs/translation/base.toml says which).
set -euo pipefail
data=$1 mesh=$2
for part in "train 0 60" "validate 1000 8" "test 2000 24"; do
  set -- $part
  realbeam-trainer simulate --seed "$2" --count "$3" "$data/streets/$1"
done
positions() {
  local part=$1 i=0
  mkdir -p "$data/delft/$part"
  shift
  for at in "$@"; do
    realbeam-trainer simulate --mesh "$mesh" --position-m ${at/,/ } 1.73 "$(printf '%s/delft/%s/%06d.ply' "$data" "$part" "$i")"
    i=$((i + 1))
  done
}
positions train 110,10 110,30 130,-10 130,10 150,-10 150,-30 150,0 170,-30 170,-50 190,-50 190,-70 200,-80 210,-110 210,-130 210,-70 \
  210,-90 230,-110 230,-130 230,-90 90,30
positions test -10,130 10,110 10,130 20,120 30,110 30,90 50,70 50,90 60,80 70,70
