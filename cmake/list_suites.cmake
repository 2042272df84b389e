# Read by ctest before it runs, through what palpate_tests() leaves for each executable: asks the executable for
# its tests and adds one ctest test for each suite, so that what a suite's tests share is made once.
#
#   program        the executable
#   prefix         of the names: "prefix.Suite"
#   slow           what --gtest_filter calls tests that a sanitizer run leaves out; each of them is a test of its own,
#                  labelled slow-sanitized, and begins before the others, so that all cores end together
#   timeout        seconds, of one test here
#   results        folder: "prefix.Suite.xml" will tell how each test of the suite ended (tools/count_tests reads it)

# list_tests(OUT FILTER): the full names of the tests that a filter names
function(list_tests out filter)
  execute_process(COMMAND ${program} --gtest_list_tests --gtest_filter=${filter}
                  OUTPUT_VARIABLE listed ERROR_VARIABLE complaint RESULT_VARIABLE failed)
  if(failed)
    message(FATAL_ERROR "${program} does not list its tests: ${failed}\n${complaint}")
  endif()
  set(names "")
  set(suite "")
  # what stands in brackets or behind semicolons in a parameter's value is no list of CMake's
  string(REGEX REPLACE "#[^\n]*" "" listed "${listed}")
  string(REPLACE "\n" ";" lines "${listed}")
  foreach(line IN LISTS lines)
    if(line MATCHES "^([^ ]+\\.) *$")
      set(suite ${CMAKE_MATCH_1})
    elseif(line MATCHES "^  ([^ ]+) *$")
      list(APPEND names ${suite}${CMAKE_MATCH_1})
    endif()
  endforeach()
  set(${out} "${names}" PARENT_SCOPE)
endfunction()

# add_one(NAME TESTS PROPERTIES...): one run of the executable for these tests
function(add_one name tests)
  list(JOIN tests ":" filter)
  string(REPLACE "/" "-" file ${name})
  add_test(${prefix}.${name} ${program} --gtest_filter=${filter} --gtest_output=xml:${results}/${prefix}.${file}.xml)
  set_tests_properties(${prefix}.${name} PROPERTIES TIMEOUT ${timeout} ${ARGN})
endfunction()

if(NOT EXISTS ${program})
  # as ctest says of any program that was not built: a failure
  add_test(${prefix}_NOT_BUILT ${program})
  return()
endif()

list_tests(every "*")
set(others ${every})
if(slow)
  list_tests(slow_ones "${slow}")
  list(REMOVE_ITEM others ${slow_ones})
  foreach(test IN LISTS slow_ones)
    add_one(${test} ${test} LABELS slow-sanitized COST 50)
  endforeach()
endif()

set(suites "")
foreach(test IN LISTS others)
  string(REGEX REPLACE "\\..*" "" suite ${test})
  list(APPEND suites ${suite})
  list(APPEND tests_of_${suite} ${test})
endforeach()
list(REMOVE_DUPLICATES suites)
foreach(suite IN LISTS suites)
  add_one(${suite} "${tests_of_${suite}}" ${properties})
endforeach()
