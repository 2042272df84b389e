#!/bin/bash
# a cohort of four knees and one file that is broken, into results: the last case fails, so the exit code is 3
printf 'NRRD0004\ntyp' > k05.nrrd
code=0
palpate -q cohort cases.tsv -o results || code=$?
[[ $code == 0 || $code == 3 ]]
