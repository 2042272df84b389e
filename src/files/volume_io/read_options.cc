#include "volume_io/read_options.h"

namespace palpate {

using namespace volume_io;

namespace {

PlacementOptions& process_placement_options() {
  static PlacementOptions placement_options;
  return placement_options;
}

ReadAs& read_as_of_process() {
  static ReadAs kind = ReadAs::kByContent;
  return kind;
}

}  // namespace

PlacementOptions volume_io::with_process_defaults(PlacementOptions placement_options) {
  const PlacementOptions& all = process_placement_options();
  if (!placement_options.mesh.space) placement_options.mesh.space = all.mesh.space;
  if (!placement_options.mesh.unit_mm) placement_options.mesh.unit_mm = all.mesh.unit_mm;
  if (!placement_options.image_spacing_mm) placement_options.image_spacing_mm = all.image_spacing_mm;
  if (!placement_options.nifti_form) placement_options.nifti_form = all.nifti_form;
  placement_options.scan_is_cropped = placement_options.scan_is_cropped || all.scan_is_cropped;
  return placement_options;
}

void set_placement_options(const PlacementOptions& placement_options) {
  process_placement_options() = placement_options;
}

const PlacementOptions& placement_options() {
  return process_placement_options();
}

void set_read_as(ReadAs kind) {
  read_as_of_process() = kind;
}

ReadAs read_as() {
  return read_as_of_process();
}

}  // namespace palpate
