# Builds the viewer's page, or runs its unit tests, with npm. Called as a script (-P) by web/CMakeLists.txt:
#
#   NPM      the program
#   WEB      this folder
#   SOURCES  what the page is made of, separated by |
#   SHARED   folder that all build folders share: a page by the hash of its sources
#   FILES    names of the page's files, separated by |: all that its build makes
#   OUT      where they go
#   STEP     build, test, or strokes: drags over scenes, with PALPATE, the program, and DRAGS, their number
cmake_minimum_required(VERSION 3.25)

# runs a command in WEB without a word; shows what it said when it fails
function(run_quietly log what)
  execute_process(COMMAND ${ARGN} WORKING_DIRECTORY ${WEB} OUTPUT_FILE ${log} ERROR_FILE ${log} RESULT_VARIABLE failed)
  if(failed)
    file(READ ${log} said)
    message(FATAL_ERROR "${said}\n${what}\nThe whole of it is in ${log}.")
  endif()
endfunction()

# one at a time, for node_modules is one
file(MAKE_DIRECTORY ${SHARED})
file(LOCK ${SHARED}/lock TIMEOUT 900 RESULT_VARIABLE locked)
if(NOT locked STREQUAL "0")
  message(FATAL_ERROR "another build has held ${SHARED}/lock for 15 minutes: ${locked}")
endif()

function(install_packages)
  file(SHA256 ${WEB}/package-lock.json wanted)
  set(stamp ${WEB}/node_modules/.palpate-lock)
  set(installed "")
  if(EXISTS ${stamp})
    file(READ ${stamp} installed)
  endif()
  if(NOT installed STREQUAL wanted)
    run_quietly(${SHARED}/npm-ci.log
      "npm ci failed. It fetches the page's packages from registry.npmjs.org once, so it needs the network then."
      ${NPM} ci --ignore-scripts --no-audit --no-fund --loglevel=error)
    file(WRITE ${stamp} ${wanted})
  endif()
endfunction()

if(STEP STREQUAL "test")
  install_packages()
  execute_process(COMMAND ${NPM} test --silent WORKING_DIRECTORY ${WEB} RESULT_VARIABLE failed)
  if(failed)
    message(FATAL_ERROR "the page's unit tests failed")
  endif()
  return()
endif()

if(STEP STREQUAL "strokes")
  install_packages()
  execute_process(COMMAND ${NPM} run --silent strokes -- ${PALPATE} ${DRAGS} ${SCENES} WORKING_DIRECTORY ${WEB} RESULT_VARIABLE failed)
  if(failed EQUAL 77)
    message("web.strokes: skipped")
  elseif(failed)
    message(FATAL_ERROR "strokes over the scenes failed")
  endif()
  return()
endif()

set(hashes "")
string(REPLACE "|" ";" sources "${SOURCES}")
foreach(file ${sources})
  file(SHA256 ${file} hash)
  file(RELATIVE_PATH name ${WEB} ${file})
  string(APPEND hashes "${name} ${hash}\n")
endforeach()
string(SHA256 hash "${hashes}")
string(SUBSTRING ${hash} 0 16 hash)

set(page ${SHARED}/${hash})
if(NOT EXISTS ${page})
  install_packages()
  file(REMOVE_RECURSE ${SHARED}/new)
  run_quietly(${SHARED}/npm-build.log "The viewer's page could not be built." ${NPM} run bundle -- --outDir ${SHARED}/new
              --logLevel warn)
  # one that is made and not named would be missing from palpate
  string(REPLACE "|" ";" named "${FILES}")
  file(GLOB made RELATIVE ${SHARED}/new/assets ${SHARED}/new/assets/*)
  list(APPEND made index.html)
  list(SORT made)
  list(SORT named)
  if(NOT made STREQUAL named)
    message(FATAL_ERROR "the build made ${made}, and web/CMakeLists.txt names ${named}")
  endif()
  # pages of earlier sources go, this one comes in one step
  file(GLOB old LIST_DIRECTORIES true ${SHARED}/????????????????)
  if(old)
    file(REMOVE_RECURSE ${old})
  endif()
  file(RENAME ${SHARED}/new ${page})
endif()
# newer than the sources, even where the content is the same: else the step would run every time
string(REPLACE "|" ";" files "${FILES}")
foreach(name ${files})
  set(file assets/${name})
  if(name STREQUAL "index.html")
    set(file index.html)
  endif()
  file(COPY_FILE ${page}/${file} ${OUT}/${name})
  file(TOUCH ${OUT}/${name})
endforeach()
