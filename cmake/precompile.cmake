# palpate_precompile(TARGET KIND): what most sources of the KIND (tests, libraries) include is compiled once for
# all of them, where PALPATE_PRECOMPILED_HEADERS names the kind.
#
# Such a build cannot see that an include is missing. tools/test therefore precompiles the tests' headers in one
# of its builds and the libraries' in the other: each source is compiled on its own, too.
function(palpate_precompile target kind)
  if(NOT kind IN_LIST PALPATE_PRECOMPILED_HEADERS)
    return()
  endif()
  # owns the headers of its kind, with the options that all targets of the kind share
  set(owner palpate_${kind}_headers)
  if(NOT TARGET ${owner})
    set(source ${PROJECT_BINARY_DIR}/generated/${owner}.cc)
    file(CONFIGURE OUTPUT ${source} CONTENT "int main() {}\n")
    if(kind STREQUAL "tests")
      add_executable(${owner} EXCLUDE_FROM_ALL ${source})
      target_compile_options(${owner} PRIVATE $<$<CONFIG:Release>:-O1>)
      target_link_libraries(${owner} PRIVATE GTest::gmock)
    else()
      add_library(${owner} OBJECT EXCLUDE_FROM_ALL ${source})
    endif()
    target_link_libraries(${owner} PRIVATE Eigen3::Eigen)
    # ccache looks into sources that begin with precompiled headers only where these options are set
    target_compile_options(${owner} PUBLIC
      "$<IF:$<CXX_COMPILER_ID:GNU>,-fpch-preprocess,SHELL:-Xclang -fno-pch-timestamp>")
    target_precompile_headers(${owner} PRIVATE ${PROJECT_SOURCE_DIR}/cmake/${kind}_headers.h)
  endif()
  target_compile_options(${target} PRIVATE $<TARGET_PROPERTY:${owner},INTERFACE_COMPILE_OPTIONS>)
  target_precompile_headers(${target} REUSE_FROM ${owner})
endfunction()
