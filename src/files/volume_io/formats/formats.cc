#include "volume_io/formats/formats.h"

#include <algorithm>
#include <array>

#include "palpate/base/file.h"
#include "palpate/base/reading.h"
#include "volume_io/dicom/dicom.h"
#include "volume_io/labels/label_text.h"
#include "volume_io/labels/masks.h"
#include "volume_io/mesh/meshes.h"
#include "volume_io/volume_reader.h"
#include "volume_io/voxel_stream.h"

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

// ---- folders ------------------------------------------------------------------------------------

// contents of a folder and its subfolders, to a limited depth
struct FolderContent {
  std::size_t files = 0;
  std::vector<std::string> volumes;  // paths relative to the folder
  std::optional<FileKind> other;     // kind of the first file that is known to be something else
};

FolderContent inspect_folder(const std::filesystem::path& folder) {
  constexpr std::size_t kMaxFiles = 10'000, kMaxOpened = 100;
  constexpr int kDeepest = 4;
  FolderContent content;
  std::error_code failed;
  using std::filesystem::recursive_directory_iterator;
  recursive_directory_iterator entry(folder, std::filesystem::directory_options::skip_permission_denied,
                                     failed);
  std::size_t opened = 0;
  for (; !failed && entry != recursive_directory_iterator() && content.files < kMaxFiles;
       entry.increment(failed)) {
    if (entry.depth() >= kDeepest) entry.disable_recursion_pending();
    std::error_code ignored;
    if (!entry->is_regular_file(ignored)) continue;
    ++content.files;
    if (format_of(entry->path())) {
      content.volumes.push_back(entry->path().lexically_relative(folder).string());
    } else if (opened < kMaxOpened) {
      ++opened;
      const auto kind = file_kind_of(entry->path(), unpacked_front);
      if (kind && !content.other) content.other = kind;
    }
  }
  std::sort(content.volumes.begin(), content.volumes.end());
  return content;
}

Error folder_error(const std::filesystem::path& folder) {
  const FolderContent content = inspect_folder(folder);
  const auto is_folder = [&](const std::string& with, const std::string& remedy) {
    return bad_input(folder.string(), "is a folder" + with, remedy);
  };
  if (content.files == 0) return is_folder(" without a file in it", "name a volume");
  if (!content.volumes.empty()) {
    constexpr std::size_t kNamed = 3;
    std::string names;
    for (std::size_t n = 0; n < std::min(kNamed, content.volumes.size()); ++n)
      names += (n == 0 ? "" : ", ") + content.volumes[n];
    if (content.volumes.size() > kNamed)
      names += " and " + std::to_string(content.volumes.size() - kNamed) + " more";
    return is_folder(", not a file", "name a file in it: " + names);
  }
  if (content.other)
    return is_folder(" without a volume in it",
                     "there is " + content.other->what + ": " + content.other->remedy);
  return is_folder(" without a volume in it", "name a volume: NRRD, NIfTI, MetaImage or DICOM, or a surface");
}

// other file of a pair: "knee.hdr" and "knee.img", each optionally with ".gz"
Result<std::filesystem::path> partner(const std::filesystem::path& file, const std::string& ending) {
  std::filesystem::path stem = file;
  if (has_extension(stem, ".gz")) stem.replace_extension();
  for (const std::string& other : {ending, ending + ".gz"}) {
    std::filesystem::path candidate = stem;
    candidate.replace_extension(other);
    std::error_code ignored;
    if (!std::filesystem::is_regular_file(candidate, ignored)) continue;
    if (auto stays = check_stays_in(file.parent_path(), candidate); !stays) return stays.error();
    return candidate;
  }
  return bad_input(file.string(), "its other half (" + ending + ") is missing",
                   "a .hdr and its .img belong together");
}

}  // namespace

void name_format(const Format& format, VolumeFile& volume) {
  const bool is_slicer = volume.header.has_segments && format.writer == ItkFormat::kNrrd;
  volume.header.format = is_slicer ? "Slicer segmentation (NRRD)" : format.name;
  volume.header.component_type = name_of(volume.voxels.component);
}

bool has_extension(const std::filesystem::path& file, std::string_view ending) {
  const std::string name = lower_case(file.filename().string());
  return name.size() > ending.size() && std::string_view(name).substr(name.size() - ending.size()) == ending;
}

Result<const Format*> format_of(const std::filesystem::path& file) {
  for (const Format& format : kFormats)
    for (const std::string_view ending : format.extensions)
      if (has_extension(file, ending)) return &format;
  return bad_input(file.string(), "has an unsupported format",
                   "use NRRD (.nrrd, .nhdr, .seg.nrrd), NIfTI (.nii, .nii.gz, .hdr/.img) or MetaImage (.mha, "
                   ".mhd); DICOM files may have any name");
}

std::optional<FileKind> file_kind_of(const std::filesystem::path& file, const Unpack& unpack) {
  std::error_code failed;
  const std::uint64_t size = std::filesystem::file_size(file, failed);
  const auto front = read_front(file, Encoding::kRaw, kKindBytes);
  if (failed || !front) return std::nullopt;
  const std::string name = file.filename().string();
  if (!front->starts_with("\x1f\x8b")) return kind_of(*front, name, size);
  // the extension before ".gz" is used too
  const std::string unpacked = unpack(file, kKindBytes);
  auto inside = kind_of(unpacked, has_extension(file, ".gz") ? file.stem().string() : name, 0);
  if (inside) inside->what += ", compressed by gzip";
  if (inside && inside->mesh) {
    inside->mesh.reset();
    inside->readable_format = {};
    inside->remedy = "unpack it first";
  }
  return inside;
}

std::optional<Error> not_a_file(const std::filesystem::path& file) {
  std::error_code ignored;
  const auto status = std::filesystem::status(file, ignored);
  if (status.type() == std::filesystem::file_type::not_found)
    return bad_input(file.string(), "no such file", "check the name and the folder");
  if (std::filesystem::is_directory(status)) return folder_error(file);
  return std::nullopt;
}

Result<std::filesystem::path> find_other_file(const std::filesystem::path& file, const OtherFile& requested) {
  switch (requested.which) {
    case OtherFile::Which::kHeader:
      return partner(file, ".hdr");
    case OtherFile::Which::kVoxels:
      return partner(file, ".img");
    case OtherFile::Which::kNamed:
      break;
  }
  return data_file_beside(file, requested.name);
}

Result<std::filesystem::path> OtherFiles::find(const OtherFile& requested) {
  for (const auto& [known, file] : entries_)
    if (known == requested) return file;
  requested_ = requested;
  return bad_input("", "another file is needed first");
}

Result<VolumeFile> inspect_file(const Format& format, const std::filesystem::path& file, OtherFiles& others,
                                const PlacementOptions& placement_options) {
  auto volume = format.inspect(file, others, placement_options);
  if (volume || others.requested()) return volume;
  // the content may be of another kind than the name says
  const auto unpack = [](const std::filesystem::path& packed, std::size_t bytes) {
    const auto front = read_front(packed, Encoding::kDeflate, bytes);
    return front ? *front : std::string();
  };
  const auto kind = file_kind_of(file, unpack);
  if (!kind || kind->readable_format == format.name) return volume;
  return bad_input(file.string(), "is " + kind->what + ", not " + format.name + " as its name says",
                   kind->remedy);
}

}  // namespace palpate::volume_io

namespace palpate {

using namespace volume_io;

bool is_volume(const std::filesystem::path& file) {
  std::error_code ignored;
  if (is_dicom(file) || is_meshes(file) || is_masks(file) || !dicom_segmentation_files(file).empty() ||
      is_image_stack(file))
    return true;
  if (!std::filesystem::is_regular_file(file, ignored)) return false;
  if (format_of(file)) return true;
  const auto kind = file_kind_of(file, unpacked_front);
  return kind && !kind->readable_format.empty();
}

std::optional<Error> describe_non_volume(const std::filesystem::path& file) {
  std::error_code ignored;
  const auto status = std::filesystem::status(file, ignored);
  if (is_dicom(file) || is_meshes(file) || is_masks(file) || !dicom_segmentation_files(file).empty() ||
      is_image_stack(file))
    return std::nullopt;
  if (std::filesystem::is_directory(status)) return folder_error(file);
  if (!std::filesystem::is_regular_file(status) || format_of(file)) return std::nullopt;
  const auto kind = file_kind_of(file, unpacked_front);
  if (!kind || !kind->readable_format.empty()) return std::nullopt;
  return bad_input(file.string(), "is " + kind->what, kind->remedy);
}

}  // namespace palpate
