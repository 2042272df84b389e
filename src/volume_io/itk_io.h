#pragma once

#include <array>
#include <filesystem>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "palpate/base/result.h"
#include "volume_io/component.h"

/// All that meets ITK: its image IO objects, used without pipelines. Plain numbers only, because ITK
/// brings an Eigen of its own that must not meet ours in one translation unit.
namespace palpate::volume_io {

enum class ItkFormat { kNrrd, kNifti, kMetaImage };

/// A grid in LPS mm; column a of the direction is the patient direction of axis a.
struct ItkGrid {
  std::array<int, 3> dims{1, 1, 1};
  std::array<double, 3> spacing_mm{1, 1, 1}, origin_mm{0, 0, 0};
  std::array<std::array<double, 3>, 3> columns{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
};

/// Held around every use of ITK in this process, and while a process is started that will use it: it would
/// inherit whatever lock of ITK's another thread has.
class ItkSection {
 private:
  static inline std::mutex mutex_;
  std::lock_guard<std::mutex> lock_{mutex_};
};

/// How ITK understands the geometry of a file whose header has passed our own checks. Reads no voxels. For a
/// process of its own (volume_reader.h): it takes no section.
Result<ItkGrid> itk_read_grid(ItkFormat format, const std::filesystem::path& file);

/// What to write: voxels on a grid, `components` values each, value after value.
struct ItkImage {
  ItkGrid grid;
  Component component;
  int components = 1;
  const void* voxels;
  std::vector<std::pair<std::string, std::string>> text_fields;  ///< kept by NRRD only
};

/// Writes the file compressed, in place. An ITK that writes too little does not always say so: read it again.
Result<void> itk_write(ItkFormat format, const std::filesystem::path& file, const ItkImage& image);

}  // namespace palpate::volume_io
