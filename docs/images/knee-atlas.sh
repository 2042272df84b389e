#!/bin/bash
# the files of the knee atlas into this folder, as union.toml and ramps.toml name them
palpate data where knee-atlas | while IFS=$'\t' read -r _ file; do cp "$file" .; done
