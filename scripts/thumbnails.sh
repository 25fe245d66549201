#!/bin/sh
# Makes the small pictures of the shipped templates that the window's start page shows. Those of the abdomen need the scans of the
# data tests (FABRICA_TEST_DATA) and stay as they are without.
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
mkdir -p "$here/templates/pictures"
for template in "$here"/templates/*.json; do
    name=$(basename "$template" .json)
    case "$name" in
        abdomen_*)
            if [ -z "${FABRICA_TEST_DATA:-}" ]; then
                echo "templates/pictures/$name.png stays as it is: FABRICA_TEST_DATA is not set" >&2
                continue
            fi
            scan="$FABRICA_TEST_DATA/ct_abdomen_3mm_slab"
            "$here/run" render "$template" --volume "$scan.nii.gz" --labels "${scan}_labels.nii.gz" --size 320x240 \
                --out "$here/templates/pictures/$name.png"
            ;;
        *) "$here/run" render "$template" --size 320x320 --out "$here/templates/pictures/$name.png" ;;
    esac
done
