#pragma once

#include <filesystem>
#include <iosfwd>
#include <optional>
#include <string>

#include "palpate/json/json.h"
#include "palpate/volume_io/studies.h"
#include "verb.h"

/// Outputs of `palpate info` that do not describe one volume.
namespace palpate::app {

struct InfoOptions {
  std::string file;
  std::optional<std::filesystem::path> names;
  std::optional<int> volume;
  bool json = false, labels = false, scan = false;
  bool identifiers = false, keep_identifiers = false;
};

/// Volumes of a DICOM folder, as JSON and as text.
Json volumes_json(const VolumeList& list);
void print_volumes(std::ostream& out, const VolumeList& list);

/// Prints the memory that a scene or data set needs; returns the exit code.
int run_info_of_scene(const InfoOptions& options, Console& console);
/// Prints the elements of DICOM files that identify the patient; returns the exit code.
int run_identifiers(const InfoOptions& options, Console& console);

}  // namespace palpate::app
