#!/bin/bash
# a generated knee with stray islands and holes, examined into lint.html: it has faults, so the exit code is 3
code=0
palpate -q lint knee-phantom:islands=4,seed=2 --page lint.html || code=$?
[[ $code == 3 ]]
