# palpate_room(NAME SOURCES ... [LINK ...] [PRIVATE_LINK ...] [TESTS ...] [FUZZERS ...])
#
# One room of the house: a static library palpate_NAME, its unit tests (NAME_test, one executable
# for all *_test.cc of the room) and its fuzzers (one executable a file).
function(palpate_room name)
  cmake_parse_arguments(ROOM "" "" "SOURCES;LINK;PRIVATE_LINK;TESTS;TEST_LINK;FUZZERS" ${ARGN})
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

  if(PALPATE_BUILD_TESTS AND ROOM_TESTS)
    add_executable(${name}_test ${ROOM_TESTS})
    target_link_libraries(${name}_test PRIVATE ${library} ${ROOM_TEST_LINK} GTest::gmock GTest::gtest_main)
    # what is tested is optimised; the tests themselves compile in three quarters of the time
    target_compile_options(${name}_test PRIVATE $<$<CONFIG:Release>:-O1>)
    target_compile_definitions(${name}_test PRIVATE
      PALPATE_SOURCE_DIR="${PROJECT_SOURCE_DIR}" PALPATE_BINARY_DIR="${PROJECT_BINARY_DIR}")
    gtest_discover_tests(${name}_test TEST_PREFIX ${name}. DISCOVERY_MODE PRE_TEST
                         PROPERTIES TIMEOUT 600)
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
