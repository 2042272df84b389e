set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)

find_program(CCACHE_PROGRAM ccache)
if(CCACHE_PROGRAM)
  # required by ccache for precompiled headers: it then ignores macro definitions and __DATE__, __TIME__ and
  # __TIMESTAMP__
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env CCACHE_SLOPPINESS=pch_defines,time_macros ${CCACHE_PROGRAM})
endif()

# __FILE__ relative to the sources: a package names no folder of the machine that built it, and a build folder
# elsewhere makes the same program
add_compile_options(-fmacro-prefix-map=${PROJECT_SOURCE_DIR}/=)

# a run must hash the same in every preset: no contraction into fused multiply-adds, no fast maths
add_compile_options(-Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion -ffp-contract=off)

if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  # GCC 12 warns of impossible overlaps in std::string concatenation (GCC bug 105651)
  add_compile_options(-Wno-restrict)
  # g++ allocates more than 1 GB for a unity source: let it collect garbage only from 1 GiB on
  cmake_host_system_information(RESULT memory_MiB QUERY TOTAL_PHYSICAL_MEMORY)
  cmake_host_system_information(RESULT cores QUERY NUMBER_OF_LOGICAL_CORES)
  math(EXPR memory_per_core_MiB "${memory_MiB} / ${cores}")
  if(CMAKE_UNITY_BUILD AND memory_per_core_MiB GREATER 3000)
    add_compile_options("$<$<COMPILE_LANGUAGE:CXX>:SHELL:--param ggc-min-heapsize=1048576>")
  endif()
  # References to destroyed temporaries, such as `auto` of an Eigen expression, are detected by the optimiser; sanitized
  # builds do not check them (below). tests/checks/check_dangling.py shows that it does.
  if(PROJECT_IS_TOP_LEVEL AND NOT PALPATE_SANITIZE)
    add_compile_options("$<$<CONFIG:Release>:-Werror=dangling-pointer;-Werror=uninitialized;-Werror=maybe-uninitialized>")
  endif()
endif()

# palpate_tune_tick_modules(MODULE...): tunes the modules whose code runs in every tick for processors since 2015, with
# the same instruction set: with generic tuning g++ clears small objects by `rep stos`, which has a high startup cost. A
# tick takes 4 % less (docs/decisions/archive/0072-what-a-tick-and-a-start-spend.md).
function(palpate_tune_tick_modules)
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|AMD64)$")
    foreach(module ${ARGN})
      target_compile_options(palpate_${module} PRIVATE $<$<CONFIG:Release>:-mtune=skylake>)
    endforeach()
  endif()
endfunction()

# Exploit mitigations (SECURITY.md); tests/checks/check_hardening.py verifies each in the program. Set per directory, so
# that programs that link the installed core do not inherit them. Not in sanitized builds, which detect more and lay out
# the stack themselves.
if(PALPATE_HARDEN AND NOT PALPATE_SANITIZE)
  add_compile_options(-fstack-protector-strong -fstack-clash-protection)
  if(CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|AMD64|i[3-6]86)$")
    add_compile_options(-fcf-protection=full)
  elseif(CMAKE_SYSTEM_PROCESSOR MATCHES "^(aarch64|arm64)$")
    add_compile_options(-mbranch-protection=standard)
  endif()
  # glibc checks sizes where the compiler has computed them, which wants an optimised build
  add_compile_options("$<$<CONFIG:Release,RelWithDebInfo,MinSizeRel>:-U_FORTIFY_SOURCE;-D_FORTIFY_SOURCE=3>")
  if(CMAKE_CXX_FLAGS_DEBUG MATCHES "-O[g123s]")
    add_compile_options("$<$<CONFIG:Debug>:-U_FORTIFY_SOURCE;-D_FORTIFY_SOURCE=3>")
  endif()
  add_link_options(LINKER:-z,relro LINKER:-z,now LINKER:-z,noexecstack)
  # an executable anywhere in memory, whatever the compiler does unasked
  include(CheckPIESupported)
  check_pie_supported()
endif()

if(PALPATE_SANITIZE)
  add_compile_options(-fsanitize=${PALPATE_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  add_link_options(-fsanitize=${PALPATE_SANITIZE})
  # One width of vectors and none at all show what a sanitizer can see; the tests of the release build compare
  # every target.
  add_compile_definitions("HWY_DISABLED_TARGETS=(HWY_SSSE3|HWY_SSE4|HWY_AVX3|HWY_AVX3_DL)")
  # suppressions for findings of clang's UndefinedBehaviorSanitizer in third-party headers
  if(CMAKE_CXX_COMPILER_ID STREQUAL "Clang" AND PALPATE_SANITIZE MATCHES "undefined")
    add_compile_options(-fsanitize-ignorelist=${CMAKE_CURRENT_LIST_DIR}/sanitizer_ignores.txt)
  endif()
  # Checks of g++ whose cost exceeds what only they would find (figures in docs/decisions/archive/0014-units.md).
  # AddressSanitizer sees what is read or written beyond an object, through a null pointer or by a pointer that wrapped
  # around; release builds refuse a pointer to a temporary that is gone (above). The fuzzers, by clang, keep all of these
  # for the parsers, where bytes and offsets come from outside.
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND PALPATE_SANITIZE MATCHES "address" AND PALPATE_SANITIZE MATCHES "undefined")
    add_compile_options(-fno-sanitize=object-size,pointer-overflow,null,alignment -fno-sanitize-address-use-after-scope)
  endif()
endif()

if(NOT PALPATE_SANITIZE)
  # Processors with SSSE3 but without SSE4 (2006 to 2008) run the scalar code.
  add_compile_definitions("HWY_DISABLED_TARGETS=(HWY_SSSE3|HWY_AVX3_DL)")
endif()
