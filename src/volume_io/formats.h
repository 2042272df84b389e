#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "volume_io/file_kind.h"
#include "volume_io/itk_io.h"
#include "volume_io/volume_message.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {

/// The files of a volume besides the one that the user named, as far as its reader may have them.
class OtherFiles {
 public:
  void add(OtherFile other, std::filesystem::path file) {
    known_.emplace_back(std::move(other), std::move(file));
  }
  /// Where it is known; else an Error, and asked() tells that it is needed.
  Result<std::filesystem::path> find(const OtherFile& wanted);
  const std::optional<OtherFile>& asked() const { return asked_; }

 private:
  std::vector<std::pair<OtherFile, std::filesystem::path>> known_;
  std::optional<OtherFile> asked_;
};

/// One file format. A new one is a file of its own with its inspect function, and a line in formats.cc.
struct Format {
  const char* name;
  std::span<const std::string_view> endings;  ///< in lower case, with their dot
  /// Understands the header, checks everything in it that can be wrong, reads no voxel. The format's and the
  /// type's names in the header are still to be filled in.
  Result<VolumeFile> (*inspect)(const std::filesystem::path& file, OtherFiles& others,
                                const Placing& placing);
  ItkFormat writer;
  std::span<const std::string_view> written;  ///< endings that it is written under: one file each
};

/// The format that a file's name asks for.
Result<const Format*> format_of(const std::filesystem::path& file);
/// Inspects a file, and what it is instead where its name is wrong about its format. The bytes may do
/// anything to whoever does this: volume_reader.h has a process for it.
Result<VolumeFile> understand(const Format& format, const std::filesystem::path& file, OtherFiles& others,
                              const Placing& placing);
/// The other file that a reader asks for, `file` being the one that the user named. Its reader is believed as
/// little as a header is. Errors: missing, no plain file, outside its folder where that is not allowed.
Result<std::filesystem::path> find_other_file(const std::filesystem::path& file, const OtherFile& wanted);
/// What is wrong where there is no file of this name, or a folder.
std::optional<Error> not_a_file(const std::filesystem::path& file);

bool has_ending(const std::filesystem::path& file, std::string_view ending);

/// What the file holds by its first bytes, through gzip where it is compressed so; nothing for a text, what
/// is not known and what cannot be read.
/// @param unpack  what gzip has packed: the first so many bytes of it, as far as there are any
using Unpack = std::function<std::string(const std::filesystem::path& file, std::size_t bytes)>;
std::optional<FileKind> content_of(const std::filesystem::path& file, const Unpack& unpack);

Result<VolumeFile> inspect_nrrd(const std::filesystem::path& file, OtherFiles& others,
                                const Placing& placing);
Result<VolumeFile> inspect_nifti(const std::filesystem::path& file, OtherFiles& others,
                                 const Placing& placing);
Result<VolumeFile> inspect_metaimage(const std::filesystem::path& file, OtherFiles& others,
                                     const Placing& placing);

/// The geometry as ITK reads it, checked. `dims` are ours; ITK reading others is an error.
Result<GridGeometry> itk_geometry(ItkFormat format, const std::filesystem::path& file,
                                  const std::array<int, 3>& dims);

}  // namespace palpate::volume_io
