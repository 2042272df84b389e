# palpate_tests(TARGET PREFIX [SLOW_SANITIZED FILTER]): the tests of an executable. Those that FILTER (as
# --gtest_filter has it) names prove physics by so much work that a sanitizer run leaves them out; smaller
# ones take the same code through it. They begin first, so that all cores end together.
function(palpate_tests target prefix)
  cmake_parse_arguments(TESTS "" "SLOW_SANITIZED" "" ${ARGN})
  set(discover TEST_PREFIX ${prefix}. DISCOVERY_MODE PRE_TEST)
  if(TESTS_SLOW_SANITIZED)
    gtest_discover_tests(${target} ${discover} TEST_FILTER "-${TESTS_SLOW_SANITIZED}" PROPERTIES TIMEOUT 600)
    gtest_discover_tests(${target} ${discover} TEST_FILTER "${TESTS_SLOW_SANITIZED}"
                         PROPERTIES TIMEOUT 600 LABELS slow-sanitized COST 50)
  else()
    gtest_discover_tests(${target} ${discover} PROPERTIES TIMEOUT 600)
  endif()
endfunction()

# palpate_room(NAME SOURCES ... [LINK ...] [PRIVATE_LINK ...] [TESTS ...] [SLOW_SANITIZED FILTER] [FUZZERS ...])
#
# One room of the house: a static library palpate_NAME, its unit tests (NAME_test, one executable
# for all *_test.cc of the room) and its fuzzers (one executable a file).
function(palpate_room name)
  cmake_parse_arguments(ROOM "" "SLOW_SANITIZED" "SOURCES;LINK;PRIVATE_LINK;TESTS;TEST_LINK;FUZZERS" ${ARGN})
  set(library palpate_${name})
  if(ROOM_SOURCES)
    add_library(${library} STATIC ${ROOM_SOURCES})
    set(scope PUBLIC)
    target_link_libraries(${library} PRIVATE ${ROOM_PRIVATE_LINK})
  else()
    add_library(${library} INTERFACE)
    set(scope INTERFACE)
  endif()
  target_include_directories(${library} ${scope} ${PROJECT_SOURCE_DIR}/include ${PROJECT_SOURCE_DIR}/src)
  target_link_libraries(${library} ${scope} ${ROOM_LINK})
  if(ROOM_SOURCES)
    palpate_precompile(${library} libraries)
  endif()

  if(PALPATE_BUILD_TESTS AND ROOM_TESTS)
    add_executable(${name}_test ${ROOM_TESTS})
    target_link_libraries(${name}_test PRIVATE ${library} ${ROOM_TEST_LINK} GTest::gmock GTest::gtest_main)
    # what is tested is optimised; the tests themselves compile in three quarters of the time
    target_compile_options(${name}_test PRIVATE $<$<CONFIG:Release>:-O1>)
    target_compile_definitions(${name}_test PRIVATE
      PALPATE_SOURCE_DIR="${PROJECT_SOURCE_DIR}" PALPATE_BINARY_DIR="${PROJECT_BINARY_DIR}")
    # undefined behaviour is looked for in the libraries: the tests compile in half the time without. What a
    # header defines inline may then be the tests' own copy.
    if(PALPATE_SANITIZE MATCHES "undefined")
      target_compile_options(${name}_test PRIVATE -fno-sanitize=undefined)
    endif()
    palpate_precompile(${name}_test tests)
    palpate_tests(${name}_test ${name} SLOW_SANITIZED "${ROOM_SLOW_SANITIZED}")
  endif()

  if(PALPATE_BUILD_FUZZERS)
    foreach(fuzzer ${ROOM_FUZZERS})
      get_filename_component(target ${fuzzer} NAME_WE)
      add_executable(${target} ${fuzzer})
      target_link_libraries(${target} PRIVATE ${library})
      target_link_options(${target} PRIVATE -fsanitize=fuzzer)
    endforeach()
  endif()
endfunction()
