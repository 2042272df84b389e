# palpate_tests(TARGET PREFIX [CI PATTERN ...] [NIGHTLY FILTER REASON ...] [SLOW_SANITIZED FILTER] [PROPERTIES ...])
#
# Registers the tests of a GoogleTest executable with ctest, one process per suite and lane. CI are the patterns of a
# GoogleTest filter of the tests in the lane `ci`. NIGHTLY takes pairs: a filter of tests in the lane `nightly`, and the
# reason why a landing does not need them. All others are in the lane `test` (docs/contributing/testing.md).
# SLOW_SANITIZED is a filter of tests that sanitized runs leave out because they prove physics by many repetitions of
# code that smaller tests execute as well. PROPERTIES are properties of all ctest tests.
function(palpate_tests target prefix)
  cmake_parse_arguments(TESTS "" "SLOW_SANITIZED" "CI;NIGHTLY;PROPERTIES" ${ARGN})
  list(JOIN TESTS_CI ":" TESTS_CI)
  set(listing ${CMAKE_CURRENT_BINARY_DIR}/${target}_tests.cmake)
  file(GENERATE OUTPUT ${listing} CONTENT "set(program \"$<TARGET_FILE:${target}>\")
set(prefix \"${prefix}\")
set(slow \"${TESTS_SLOW_SANITIZED}\")
set(ci \"${TESTS_CI}\")
set(nightly \"${TESTS_NIGHTLY}\")
set(properties \"${TESTS_PROPERTIES}\")
set(timeout 1800)
set(results \"${PROJECT_BINARY_DIR}/suites\")
include(\"${PROJECT_SOURCE_DIR}/cmake/list_suites.cmake\")
")
  set_property(DIRECTORY APPEND PROPERTY TEST_INCLUDE_FILES ${listing})
endfunction()

# palpate_test_options(TARGET NUMERIC BOOL): how a test's own sources are compiled in a release build. The library is
# optimised; its tests compile in two thirds of the time that -O1 takes without optimisation, and need it only where they
# loop over many points or ticks themselves.
function(palpate_test_options target)
  cmake_parse_arguments(OPTIONS "" "NUMERIC" "" ${ARGN})
  palpate_optimise_test(${target} "${OPTIONS_NUMERIC}")
  if(PALPATE_PRECOMPILE_TESTS)
    palpate_precompiled_headers(headers "${OPTIONS_NUMERIC}")
    target_precompile_headers(${target} REUSE_FROM ${headers})
    # compiled with these options, which programs without GoogleTest lack
    target_compile_options(${target} PRIVATE $<TARGET_PROPERTY:GTest::gtest,INTERFACE_COMPILE_OPTIONS>)
  endif()
endfunction()

function(palpate_optimise_test target numeric)
  if(numeric)
    target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O1>)
  else()
    # glibc's checks of sizes need an optimised build
    target_compile_options(${target} PRIVATE "$<$<CONFIG:Release>:-O0;-U_FORTIFY_SOURCE>")
    if(PALPATE_SANITIZE)
      target_compile_options(${target} PRIVATE -O0)
    endif()
  endif()
  # undefined behaviour is looked for in the libraries: the tests compile in half the time without. What a
  # header defines inline may then be the tests' own copy.
  if(PALPATE_SANITIZE MATCHES "undefined")
    target_compile_options(${target} PRIVATE -fno-sanitize=undefined)
  endif()
endfunction()

# palpate_precompiled_headers(OUT NUMERIC): the target that compiles what nearly every test includes, once for all that
# are optimised alike. GoogleMock, Eigen and the standard library are most of what a small test costs. g++ alone: the
# flags of clang's builds differ from module to module.
include(CMakeDependentOption)
cmake_dependent_option(PALPATE_PRECOMPILE_TESTS "Compile the headers that tests have in common once" ON
  "CMAKE_CXX_COMPILER_ID STREQUAL GNU" OFF)
function(palpate_precompiled_headers out numeric)
  if(numeric)
    set(target test_headers_numeric)
  else()
    set(target test_headers)
  endif()
  set(${out} ${target} PARENT_SCOPE)
  if(TARGET ${target})
    return()
  endif()
  add_library(${target} OBJECT EXCLUDE_FROM_ALL ${PROJECT_SOURCE_DIR}/tests/test_headers.cc)
  # position-independent as executables are, and not as libraries: else the tests cannot use them
  set_target_properties(${target} PROPERTIES POSITION_INDEPENDENT_CODE OFF)
  target_compile_options(${target} PRIVATE -fPIE)
  target_link_libraries(${target} PRIVATE Eigen3::Eigen GTest::gmock)
  palpate_optimise_test(${target} "${numeric}")
  target_precompile_headers(${target} PRIVATE ${PROJECT_SOURCE_DIR}/tests/test_headers.h)
endfunction()

# palpate_module(NAME [LESS_OPTIMISED] [NUMERIC_TESTS] SOURCES ... [SIMD ...] [ALONE ...] [LINK ...] [PRIVATE_LINK ...]
#              [TESTS ...] [CI PATTERN ...] [NIGHTLY FILTER REASON ...] [SLOW_SANITIZED FILTER]
#              [FUZZERS ...])
#
# A module: a static library palpate_NAME, its unit tests (NAME_test, one executable
# for all *_test.cc of the module) and its fuzzers (one executable a file). SIMD are sources that Highway compiles
# once for every target, and that therefore cannot be part of a unity source. ALONE are sources whose
# headers take long to compile, and that a change of another source should not compile again. FUZZED are the sources that
# the fuzzers' bytes reach, where most of the module's are not. LESS_OPTIMISED marks a module without
# performance-critical loops over voxels or ticks: it is compiled with -O1, in at most two thirds of the time.
# NUMERIC_TESTS says that its tests loop over many points or ticks themselves, so that they are worth optimising.
function(palpate_module name)
  cmake_parse_arguments(MODULE "LESS_OPTIMISED;NUMERIC_TESTS" "SLOW_SANITIZED" "CI;NIGHTLY;SOURCES;SIMD;ALONE;LINK;PRIVATE_LINK;TESTS;TEST_LINK;FUZZERS;FUZZED" ${ARGN})
  set(library palpate_${name})
  # private headers are included as MODULE/NAME.h
  cmake_path(GET CMAKE_CURRENT_SOURCE_DIR PARENT_PATH group)
  set(less_optimised)
  if(MODULE_LESS_OPTIMISED AND NOT PALPATE_BUILD_FUZZERS)
    set(less_optimised $<$<CONFIG:Release>:-O1>)
    if(PALPATE_SANITIZE)
      set(less_optimised -O0)
    endif()
  endif()
  set(alone ${MODULE_SIMD} ${MODULE_ALONE})
  if(alone)
    set_source_files_properties(${alone} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
  endif()
  if(name IN_LIST PALPATE_PARTIAL_MODULES)
    set(MODULE_SOURCES ${PALPATE_FUZZED_${name}})
    set(MODULE_SIMD)
    set(MODULE_ALONE)
  endif()
  if(MODULE_SOURCES)
    add_library(${library} STATIC ${MODULE_SOURCES} ${MODULE_SIMD} ${MODULE_ALONE})
    # a function that no fuzzer calls, and what it would call, are left out when one is linked
    if(name IN_LIST PALPATE_PARTIAL_MODULES OR (PALPATE_BUILD_FUZZERS AND MODULE_FUZZED))
      target_compile_options(${library} PRIVATE -ffunction-sections)
    endif()
    target_compile_options(${library} PRIVATE ${less_optimised})
    set(scope PUBLIC)
    target_link_libraries(${library} PRIVATE ${MODULE_PRIVATE_LINK})
  else()
    add_library(${library} INTERFACE)
    set(scope INTERFACE)
  endif()
  target_include_directories(${library} ${scope} $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include>
    $<BUILD_INTERFACE:${group}> $<INSTALL_INTERFACE:include>)
  target_link_libraries(${library} ${scope} ${MODULE_LINK})

  if(PALPATE_BUILD_TESTS AND MODULE_TESTS)
    add_executable(${name}_test ${MODULE_TESTS})
    target_link_libraries(${name}_test PRIVATE ${library} ${MODULE_TEST_LINK} GTest::gmock GTest::gtest_main)
    palpate_test_options(${name}_test NUMERIC ${MODULE_NUMERIC_TESTS})
    target_compile_definitions(${name}_test PRIVATE
      PALPATE_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
    palpate_tests(${name}_test ${name} CI ${MODULE_CI} NIGHTLY ${MODULE_NIGHTLY} SLOW_SANITIZED "${MODULE_SLOW_SANITIZED}")
  endif()

  if(PALPATE_BUILD_FUZZERS AND MODULE_FUZZERS)
    # coverage for what is fuzzed; each fuzzer adds the driver
    if(MODULE_FUZZED)
      target_compile_options(${library} PRIVATE -fno-sanitize=all -O0)
      set_source_files_properties(${MODULE_FUZZED} PROPERTIES
        COMPILE_OPTIONS "-fsanitize=${PALPATE_SANITIZE},fuzzer-no-link;-O1" SKIP_UNITY_BUILD_INCLUSION ON)
    else()
      target_compile_options(${library} PRIVATE -fsanitize=fuzzer-no-link)
    endif()
    foreach(fuzzer ${MODULE_FUZZERS})
      get_filename_component(target ${fuzzer} NAME_WE)
      add_executable(${target} ${fuzzer})
      target_compile_options(${target} PRIVATE -fsanitize=fuzzer-no-link)
      target_link_libraries(${target} PRIVATE ${library})
      target_link_options(${target} PRIVATE -fsanitize=fuzzer LINKER:--gc-sections)
    endforeach()
  endif()
endfunction()
