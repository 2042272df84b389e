#include "large_knee.h"

#include <cstdlib>
#include <filesystem>
#include <sstream>

#include "palpate/phantoms/phantoms.h"
#include "palpate/volume_io/volume_io.h"

namespace palpate::bench {
namespace {

constexpr double kGeneratedVoxel_mm = 0.36;

std::string shared_knee() {
  const char* folders = std::getenv("PALPATE_DATA");
  std::istringstream list(folders != nullptr ? folders : "");
  for (std::string folder; std::getline(list, folder, ':');) {
    const auto file = std::filesystem::path(folder) / "knee_spl" / "seg.nrrd";
    if (!folder.empty() && std::filesystem::exists(file)) return file.string();
  }
  return "";
}

}  // namespace

Result<LabelMap> large_knee(const std::string& file, std::string& what) {
  const std::string found = file.empty() ? shared_knee() : file;
  if (found.empty()) {
    what = "generated knee";
    auto phantom = make_knee_phantom(kGeneratedVoxel_mm, 1);
    if (!phantom) return phantom.error();
    return std::move(phantom->labels);
  }
  what = "segmented knee";
  auto read = read_labels(found);
  if (!read) return read.error();
  return std::move(read->labels);
}

}  // namespace palpate::bench
