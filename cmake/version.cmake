# palpate_version: the version, the commit and the build type as a generated header, refreshed at
# every build so that a recording never names a stale commit.
set(version_dir ${PROJECT_BINARY_DIR}/generated)
add_custom_target(palpate_version_file ALL
  COMMAND ${CMAKE_COMMAND} -DSOURCE_DIR=${PROJECT_SOURCE_DIR} -DOUTPUT=${version_dir}/palpate_version.h
          -DVERSION=${PROJECT_VERSION} -DBUILD_TYPE=${CMAKE_BUILD_TYPE}
          "-DCOMPILER=${CMAKE_CXX_COMPILER_ID} ${CMAKE_CXX_COMPILER_VERSION}"
          -DSANITIZE=${PALPATE_SANITIZE} -P ${PROJECT_SOURCE_DIR}/cmake/write_version.cmake
  BYPRODUCTS ${version_dir}/palpate_version.h
  VERBATIM)
add_library(palpate_version INTERFACE)
target_include_directories(palpate_version INTERFACE ${version_dir})
add_dependencies(palpate_version palpate_version_file)
