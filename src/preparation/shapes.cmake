# the geometric primitives and the phantoms made of them: appended to the room's lists
list(APPEND PREPARATION_SOURCES
  shape_primitives.cc shape_ellipsoid.cc shape_combine.cc voxelize.cc
  phantoms.cc phantom_keys.cc phantom_name.cc phantom_painter.cc phantom_scan.cc segmentation_noise.cc
  knee_phantom.cc knee_phantom_anatomy.cc shell_phantom.cc skull_phantom.cc gland_phantom.cc)
list(APPEND PREPARATION_TESTS
  shape_test.cc shape_ellipsoid_test.cc shape_combine_test.cc voxelize_test.cc
  knee_phantom_test.cc phantom_scan_test.cc phantom_name_test.cc phantoms_test.cc)
