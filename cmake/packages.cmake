# `make package` (tools/make_packages): the Debian packages of the components of cmake/install.cmake, by CPack.
#
#   palpate          the program             component program
#   libpalpate1      libpalpate.so           component library
#   libpalpate-dev   headers, CMake package  components core and c
#   python3-palpate  the Python package      component python
set(PALPATE_PACKAGER "palpate developers <developers@palpate.invalid>" CACHE STRING
  "Maintainer that the Debian packages name: who distributes them, with an address")

set(CPACK_PACKAGE_NAME palpate)
set(CPACK_PACKAGE_CONTACT "${PALPATE_PACKAGER}")
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "${PROJECT_DESCRIPTION}")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_GENERATOR DEB)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL program library core c python)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
  OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
set(CPACK_PRE_BUILD_SCRIPTS ${PROJECT_SOURCE_DIR}/cmake/finish_packages.cmake)

# palpate_debian_package(COMPONENT NAME SECTION SUMMARY DESCRIPTION DEPENDS...)
macro(palpate_debian_package component name section summary description)
  string(TOUPPER ${component} palpate_upper)
  set(CPACK_DEBIAN_${palpate_upper}_PACKAGE_NAME ${name})
  set(CPACK_DEBIAN_${palpate_upper}_PACKAGE_SECTION ${section})
  set(CPACK_DEBIAN_${palpate_upper}_DESCRIPTION "${summary}\n${description}")
  string(REPLACE ";" ", " CPACK_DEBIAN_${palpate_upper}_PACKAGE_DEPENDS "${ARGN}")
endmacro()
set(palpate_same_library "libpalpate1 (= ${PROJECT_VERSION})")
palpate_debian_package(program palpate science "haptic rendering of segmented MRI and CT scans"
  "Computes the forces on a tool that touches a segmented scan, from the\nvoxels themselves, for haptic devices, simulated hands \
and a mouse in a\nweb page. For research and education, not for clinical use." "${palpate_same_library}")
palpate_debian_package(library libpalpate1 libs "haptic rendering of segmented scans, C library"
  "The shared library by which programs in C, and in languages that call C,\ncompute forces on tools that touch segmented scans.")
palpate_debian_package(development libpalpate-dev libdevel "haptic rendering of segmented scans, development files"
  "Headers, CMake and pkg-config files of the C library, and the core as\nstatic libraries for C++20."
  "${palpate_same_library}" libeigen3-dev libhwy-dev pkg-config)
palpate_debian_package(python python3-palpate python "haptic rendering of segmented scans, Python package"
  "NumPy arrays in, forces, simulated palpations and recordings out." "${palpate_same_library}" python3 python3-numpy)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_LIBRARY_PACKAGE_SHLIBDEPS ON)
# shared library and its trigger, as Debian's policy asks; CPack's GENERATE_SHLIBS knows no trigger
set(palpate_control ${PROJECT_BINARY_DIR}/generated/control)
file(WRITE ${palpate_control}/shlibs "libpalpate ${PROJECT_VERSION_MAJOR} libpalpate1 (>= ${PROJECT_VERSION})\n")
file(WRITE ${palpate_control}/triggers "activate-noawait ldconfig\n")
set(CPACK_DEBIAN_LIBRARY_PACKAGE_CONTROL_EXTRA ${palpate_control}/shlibs ${palpate_control}/triggers)
set(CPACK_DEBIAN_PYTHON_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SUGGESTS python3-h5py)

include(CPack)
cpack_add_component_group(development)
cpack_add_component(core GROUP development)
cpack_add_component(c GROUP development)

# rules of USB devices, where the system looks for those of packages
install(FILES ${PROJECT_SOURCE_DIR}/data/system/60-palpate-haptics.rules DESTINATION lib/udev/rules.d COMPONENT program)

# what the packages are made of
add_custom_target(palpate_packaged DEPENDS palpate palpate-verify palpate_c palpate_dicom palpate_ros2_dds)
foreach(module ${core_modules})
  get_target_property(palpate_type palpate_${module} TYPE)
  if(palpate_type STREQUAL STATIC_LIBRARY)
    add_dependencies(palpate_packaged palpate_${module})
  endif()
endforeach()
