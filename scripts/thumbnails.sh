#!/bin/sh
# Makes the small pictures of the shipped templates that the window's start page shows.
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
mkdir -p "$here/templates/pictures"
for template in "$here"/templates/*.json; do
    name=$(basename "$template" .json)
    "$here/run" render "$template" --size 320x320 --out "$here/templates/pictures/$name.png"
done
