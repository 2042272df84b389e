# Read by ctest before it runs, through the file that palpate_tests() generates for each test executable. Asks the
# executable for its tests and registers one ctest test per suite and lane, so that a suite's fixtures are set up once.
#
#   program        the executable
#   prefix         of the names: "prefix.Suite", and "prefix.Suite-LANE" for the suite's tests in another lane than `test`
#   slow           GoogleTest filter of the tests that sanitized runs leave out; each is registered by itself, labelled
#                  slow-sanitized, with a high cost so that ctest starts it first
#   ci             GoogleTest filter of the tests in the lane `ci`
#   nightly        pairs of a GoogleTest filter of tests in the lane `nightly` and the reason why a landing does not need
#                  them; all other tests are in the lane `test`
#   properties     ctest properties of all tests
#   timeout        of one ctest test, seconds
#   results        folder: "prefix.Suite.xml" receives GoogleTest's result of each test (tools/count_tests reads it)
#
# Every test gets exactly one of the labels lane-test, lane-ci and lane-nightly, the latter with a label "reason: ..."
# beside it (docs/contributing/testing.md).

cmake_policy(VERSION 3.25)

# list_tests(OUT FILTER): the full names of the tests that match a GoogleTest filter
function(list_tests out filter)
  execute_process(COMMAND ${program} --gtest_list_tests --gtest_filter=${filter}
                  OUTPUT_VARIABLE listed ERROR_VARIABLE complaint RESULT_VARIABLE failed)
  if(failed)
    message(FATAL_ERROR "${program} does not list its tests: ${failed}\n${complaint}")
  endif()
  set(names "")
  set(suite "")
  # brackets and semicolons in a parameter's value would be read as CMake lists
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

# add_one(NAME TESTS LABELS PROPERTIES...): one run of the executable for these tests
function(add_one name tests labels)
  list(JOIN tests ":" filter)
  string(REPLACE "/" "-" file ${name})
  add_test(${prefix}.${name} ${program} --gtest_filter=${filter} --gtest_output=xml:${results}/${prefix}.${file}.xml)
  set_tests_properties(${prefix}.${name} PROPERTIES TIMEOUT ${timeout} LABELS "${labels}" ${ARGN})
endfunction()

if(NOT EXISTS ${program})
  # ctest reports a test whose program was not built as failed
  add_test(${prefix}_NOT_BUILT ${program})
  set_tests_properties(${prefix}_NOT_BUILT PROPERTIES LABELS lane-test)
  return()
endif()

# match(OUT FILTER): the tests that match; a filter without any would hide that a test has been renamed
function(match out filter)
  list_tests(names "${filter}")
  if(NOT names)
    message(FATAL_ERROR "${program}: no test matches '${filter}'")
  endif()
  set(${out} "${names}" PARENT_SCOPE)
endfunction()

# A function, because ctest includes the files of all executables into one scope.
function(register_tests)
  list_tests(every "*")
  set(slow_tests "")
  if(slow)
    match(slow_tests "${slow}")
  endif()
  set(ci_tests "")
  if(ci)
    match(ci_tests "${ci}")
  endif()
  set(nightly_tests "")
  set(reasons "")
  while(nightly)
    list(POP_FRONT nightly filter reason)
    match(matched "${filter}")
    foreach(test IN LISTS matched)
      list(APPEND nightly_tests ${test})
      list(APPEND reasons "reason: ${reason}")
    endforeach()
  endwhile()

  set(suites "")
  foreach(test IN LISTS every)
    string(REGEX REPLACE "\\..*" "" suite ${test})
    list(FIND nightly_tests ${test} nth)
    if(NOT nth EQUAL -1)
      list(GET reasons ${nth} reason)
      set(labels lane-nightly "${reason}")
      string(APPEND suite "-nightly")
    elseif(test IN_LIST ci_tests)
      set(labels lane-ci)
      string(APPEND suite "-ci")
    else()
      set(labels lane-test)
    endif()
    if(test IN_LIST slow_tests)
      add_one(${test} ${test} "${labels};slow-sanitized" COST 50 ${properties})
    else()
      list(APPEND suites ${suite})
      list(APPEND tests_of_${suite} ${test})
      set(labels_of_${suite} "${labels}")
    endif()
  endforeach()
  list(REMOVE_DUPLICATES suites)
  foreach(suite IN LISTS suites)
    add_one(${suite} "${tests_of_${suite}}" "${labels_of_${suite}}" ${properties})
  endforeach()
endfunction()
register_tests()
