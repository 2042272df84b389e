#pragma once

#include <array>
#include <filesystem>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "palpate/base/result.h"
#include "volume_io/component.h"

/// Writing of volumes by ITK's image IO objects, used without pipelines. Plain data only, because ITK
/// includes its own copy of Eigen, which must not be mixed with palpate's in one translation unit.
namespace palpate::volume_io {

enum class ItkFormat { kNrrd, kNifti, kMetaImage };

/// Grid in LPS mm; column a of the direction is the patient direction of axis a.
struct ItkGrid {
  std::array<int, 3> dims{1, 1, 1};
  std::array<double, 3> spacing_mm{1, 1, 1}, origin_mm{0, 0, 0};
  std::array<std::array<double, 3>, 3> columns{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
};

/// Serialises every use of ITK in this process.
class ItkSection {
 private:
  static inline std::mutex mutex_;
  std::lock_guard<std::mutex> lock_{mutex_};
};

/// Volume to write: voxels on a grid with `components` interleaved values each.
struct ItkImage {
  ItkGrid grid;
  Component component;
  int components = 1;
  const void* voxels;
  std::vector<std::pair<std::string, std::string>> text_fields;  ///< Stored by NRRD only.
};

/// Writes the compressed file in place. ITK does not always report an incomplete write: read the file back.
Result<void> itk_write(ItkFormat format, const std::filesystem::path& file, const ItkImage& image);

}  // namespace palpate::volume_io
