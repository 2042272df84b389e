# What `cmake --install` brings. Components: `library` is libpalpate.so with the library that it and the program load for DICOM,
# `program` is palpate with its page compiled in and its man pages, `core` is what another simulator in C++ builds on (headers,
# libraries, the CMake package palpate), `c` is palpate.h with the same package, `python` is the Python package.
include(CMakePackageConfigHelpers)

# palpate_install_package(COMPONENT): the CMake package palpate, which finds the components that are installed
function(palpate_install_package component)
  set(package ${PROJECT_BINARY_DIR}/generated)
  configure_package_config_file(${PROJECT_SOURCE_DIR}/cmake/palpate-config.cmake.in ${package}/palpate-config.cmake
    INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/palpate NO_SET_AND_CHECK_MACRO)
  write_basic_package_version_file(${package}/palpate-config-version.cmake COMPATIBILITY SameMinorVersion)
  install(FILES ${package}/palpate-config.cmake ${package}/palpate-config-version.cmake DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/palpate
    COMPONENT ${component})
endfunction()

# palpate_install_core(MODULE...): the modules as targets palpate::MODULE, all of them together as palpate::core
function(palpate_install_core)
  foreach(module ${ARGN})
    set_target_properties(palpate_${module} PROPERTIES EXPORT_NAME ${module})
    install(TARGETS palpate_${module} EXPORT palpate ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT core)
    install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/palpate/${module} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/palpate COMPONENT core)
  endforeach()
  set_target_properties(palpate_core PROPERTIES EXPORT_NAME core)
  target_compile_features(palpate_core INTERFACE cxx_std_20)
  install(TARGETS palpate_core EXPORT palpate)

  install(EXPORT palpate NAMESPACE palpate:: FILE palpate-targets.cmake DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/palpate COMPONENT core)
  palpate_install_package(core)
endfunction()

# palpate_install_program(TARGET COMPANION...): the program, those programs that are verbs of it which have been built, and
# a man page for each verb, made of what its --help says
function(palpate_install_program target)
  find_package(Python3 COMPONENTS Interpreter REQUIRED)
  install(TARGETS ${target} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT program)
  install(TARGETS ${ARGN} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT program OPTIONAL)
  install(CODE "
    execute_process(COMMAND ${Python3_EXECUTABLE} ${PROJECT_SOURCE_DIR}/tools/make_man_pages $<TARGET_FILE:${target}>
      \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${CMAKE_INSTALL_MANDIR}/man1\" COMMAND_ERROR_IS_FATAL ANY)" COMPONENT program)
endfunction()
