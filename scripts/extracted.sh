#!/bin/sh
# Makes docs/images/extracted.png: a painting of three balls, styles taken from them, and a skull in each.
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
. "$here/scripts/prepare.sh"
work=$(mktemp -d)
trap 'rm -r "$work"' EXIT
paint() { cargo run --release --quiet --manifest-path "$here/Cargo.toml" -p fabrica-engine --example make_painting -- "$@"; }
paint "$work/painting.png"
number=0
for circle in 215,290,150 600,265,170 985,290,150; do
    number=$((number + 1))
    "$here/run" styles extract "$work/painting.png" --circle "$circle" --out "$work/ball_$number.png"
    sed -e "s/\"bone\"/\"ball_$number\"/; s/\"porcelain\"/\"ball_$number\"/" "$here/templates/head.json" >"$work/skull_$number.json"
    "$here/run" render "$work/skull_$number.json" --styles "$work" --background transparent --size 400x400 --out "$work/skull_$number.png"
done
paint "$here/docs/images/extracted.png" "$work/skull_1.png" "$work/skull_2.png" "$work/skull_3.png"
