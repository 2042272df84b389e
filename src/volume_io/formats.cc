#include "volume_io/formats.h"

#include <array>

#include "volume_io/label_text.h"

namespace palpate::volume_io {
namespace {

using Endings = std::span<const std::string_view>;
constexpr std::string_view kNrrd[] = {".nrrd", ".nhdr"};
constexpr std::string_view kNifti[] = {".nii", ".nii.gz", ".hdr", ".hdr.gz", ".img", ".img.gz"};
constexpr std::string_view kMetaImage[] = {".mha", ".mhd"};

const std::array<Format, 3> kFormats{{
    {"NRRD", kNrrd, inspect_nrrd, ItkFormat::kNrrd, Endings(kNrrd).first(1)},
    {"NIfTI", kNifti, inspect_nifti, ItkFormat::kNifti, Endings(kNifti).first(2)},
    {"MetaImage", kMetaImage, inspect_metaimage, ItkFormat::kMetaImage, Endings(kMetaImage).first(1)},
}};

}  // namespace

bool has_ending(const std::filesystem::path& file, std::string_view ending) {
  const std::string name = lower_case(file.filename().string());
  return name.size() > ending.size() && std::string_view(name).substr(name.size() - ending.size()) == ending;
}

Result<const Format*> format_of(const std::filesystem::path& file) {
  for (const Format& format : kFormats)
    for (const std::string_view ending : format.endings)
      if (has_ending(file, ending)) return &format;
  return bad_input(
      file.string(), "is of no format that is read or written here",
      "use NRRD (.nrrd, .nhdr, .seg.nrrd), NIfTI (.nii, .nii.gz, .hdr/.img) or MetaImage (.mha, .mhd)");
}

Result<VolumeFile> inspect(const std::filesystem::path& file) {
  std::error_code ignored;
  const auto status = std::filesystem::status(file, ignored);
  if (status.type() == std::filesystem::file_type::not_found)
    return bad_input(file.string(), "no such file", "check the name and the folder");
  if (std::filesystem::is_directory(status))
    return bad_input(file.string(), "is a folder, not a file", "name a file in it");
  if (!std::filesystem::is_regular_file(status)) return bad_input(file.string(), "is not a plain file");
  const auto format = format_of(file);
  if (!format) return format.error();
  return (*format)->inspect(file);
}

Result<GridGeometry> itk_geometry(ItkFormat format, const std::filesystem::path& file,
                                  const std::array<int, 3>& dims) {
  const auto grid = itk_read_grid(format, file);
  if (!grid) return grid.error();
  if (grid->dims != dims) return bad_input(file.string(), "its header contradicts itself about its sizes");
  GridGeometry geometry;
  geometry.dims = dims;
  geometry.spacing_mm = Eigen::Vector3d(grid->spacing_mm.data());
  geometry.origin = Point<Patient>(Eigen::Vector3d(grid->origin_mm.data()));
  for (std::size_t a = 0; a < 3; ++a)
    geometry.direction.col(static_cast<int>(a)) = Eigen::Vector3d(grid->columns[a].data());
  return checked(geometry, file.string());
}

Result<GridGeometry> checked(const GridGeometry& geometry, const std::string& source) {
  if (!geometry.spacing_mm.allFinite() || !geometry.direction.allFinite() || !geometry.origin.all_finite())
    return bad_input(source, "its geometry holds something that is not a number");
  if (geometry.spacing_mm.minCoeff() <= 0) return bad_input(source, "its spacing is not positive");
  // unit columns: the determinant is the volume of their box, 1 when they are square to each other
  constexpr double kFlat = 1e-3;
  if (std::abs(geometry.direction.determinant()) < kFlat)
    return bad_input(source, "its axes lie in one plane, they span no volume",
                     "repair its directions from the scan");
  return geometry;
}

}  // namespace palpate::volume_io
