set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)

find_program(CCACHE_PROGRAM ccache)
if(CCACHE_PROGRAM)
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CCACHE_PROGRAM})
endif()

# a run must hash the same in every preset: no contraction into fused multiply-adds, no fast maths
add_compile_options(-Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion -ffp-contract=off)

if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  # GCC 12 warns of impossible overlaps in std::string concatenation (GCC bug 105651)
  add_compile_options(-Wno-restrict)
endif()

if(PALPATE_SANITIZE)
  add_compile_options(-fsanitize=${PALPATE_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  add_link_options(-fsanitize=${PALPATE_SANITIZE})
  # Two widths of vectors and none at all show what a sanitizer can see; the release build has every target of
  # Highway's, and its tests compare them all.
  add_compile_definitions("HWY_DISABLED_TARGETS=(HWY_SSSE3|HWY_AVX3|HWY_AVX3_DL)")
  # What is read or written beyond an object, or by a pointer that wrapped around, AddressSanitizer sees; not a
  # wrapped pointer that nobody follows. These two checks took g++ a seventh of its time. The fuzzers, by clang,
  # keep them for the parsers, where offsets come from outside.
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND PALPATE_SANITIZE MATCHES "address" AND PALPATE_SANITIZE MATCHES "undefined")
    add_compile_options(-fno-sanitize=object-size,pointer-overflow)
  endif()
endif()
