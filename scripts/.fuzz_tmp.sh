#!/usr/bin/env bash
# fuzz.sh [TARGET [RUNS]]: fuzz targets with the small files of the data folder as seeds.
set -euo pipefail
cd "$(dirname "$0")/.."
data=${FABRICA_TEST_DATA:-../shared/data}
runs=${2:-1000000}
command -v cargo-fuzz >/dev/null || cargo install --locked cargo-fuzz
targets=${1:-$(cargo +nightly fuzz list)}

seeds() { # TARGET NAME...: files of at most 64 kB
    local target=$1 file
    shift
    mkdir -p "fuzz/corpus/$target"
    for file in "$@"; do
        if [ -f "$file" ] && [ "$(wc -c <"$file")" -le 65536 ]; then
            cp -f --no-preserve=mode "$file" "fuzz/corpus/$target/$(basename "$(dirname "$file")")-$(basename "$file")"
        fi
    done
}

for target in $targets; do
    case $target in
        nifti) seeds nifti "$data"/*.nii "$data"/*.hdr
            # Compressed seeds change in their checksum first of all: they are given decompressed, too.
            for file in "$data"/*.nii.gz; do
                gunzip -c "$file" 2>/dev/null | head -c 8192 >"fuzz/corpus/nifti/$(basename "$file" .gz)" || true
            done ;;
        nifti_gz) seeds nifti_gz "$data"/*.nii.gz ;;
        nrrd) seeds nrrd "$data"/*.nrrd
            for file in "$data"/*.nrrd; do head -c 8192 "$file" >"fuzz/corpus/nrrd/$(basename "$file")"; done ;;
        metaimage | metaimage_header)
            seeds "$target" "$data"/*.mhd
            for file in "$data"/*.mha; do head -c 8192 "$file" >"fuzz/corpus/$target/$(basename "$file")"; done ;;
        dicom) seeds dicom "$data"/dicom_odd/*.dcm "$data"/pet_seg_dicom/*
            # A few slices of a series are enough.
            mapfile -t slices < <(find "$data/pet_wb_dicom" -type f | sort | head -3)
            seeds dicom "${slices[@]}" ;;
        template) seeds template templates/*.json ;;
        *) mkdir -p "fuzz/corpus/$target" ;;
    esac
    # Headers matter more than voxels: long inputs only cost time.
    features=()
    if [ "$target" = template ]; then features=(--features template); fi
    cargo +nightly fuzz run "${features[@]}" "$target" -- -max_total_time=70 -max_len=65536 -timeout=10 -rss_limit_mb=3072 -print_final_stats=1
done
