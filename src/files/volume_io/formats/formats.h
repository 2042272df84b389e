#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "volume_io/formats/file_kind.h"
#include "volume_io/formats/itk_io.h"
#include "volume_io/volume_message.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {

/// Files that a volume consists of in addition to the one named by the user, as far as its reader has access
/// to them.
class OtherFiles {
 public:
  void add(OtherFile other, std::filesystem::path file) {
    entries_.emplace_back(std::move(other), std::move(file));
  }
  /// Path of a file if it is known; otherwise an Error, and requested() returns the request.
  Result<std::filesystem::path> find(const OtherFile& requested);
  const std::optional<OtherFile>& requested() const { return requested_; }

 private:
  std::vector<std::pair<OtherFile, std::filesystem::path>> entries_;
  std::optional<OtherFile> requested_;
};

/// A file format. To add one, write a source file with its inspect function and add a line to formats.cc.
struct Format {
  const char* name;
  std::span<const std::string_view> extensions;  ///< Extensions in lower case, with the dot.
  /// Parses and validates the header without reading voxels. The names of format and type in the header are
  /// filled in by the caller.
  Result<VolumeFile> (*inspect)(const std::filesystem::path& file, OtherFiles& others,
                                const PlacementOptions& placement_options);
  ItkFormat writer;
  /// Extensions under which it is written, as a single file.
  std::span<const std::string_view> write_extensions;
};

/// Format by the extension of a file.
Result<const Format*> format_of(const std::filesystem::path& file);
/// Inspects a file; if its name suggests the wrong format, the error names the actual one. Untrusted bytes
/// may compromise the process: call it in a reader process (volume_reader.h).
Result<VolumeFile> inspect_file(const Format& format, const std::filesystem::path& file, OtherFiles& others,
                                const PlacementOptions& placement_options);
/// Locates the additional file that a reader requests.
/// @param file       the file that the user named
/// @param requested  request of the reader, which is as untrusted as a header
/// Errors: missing; not a regular file; outside the folder unless that is allowed.
Result<std::filesystem::path> find_other_file(const std::filesystem::path& file, const OtherFile& requested);
/// Error for a path that does not exist or is a folder; nullopt otherwise.
std::optional<Error> not_a_file(const std::filesystem::path& file);

/// Sets the names of format and type, which no inspect function sets.
void name_format(const Format& format, VolumeFile& volume);

bool has_extension(const std::filesystem::path& file, std::string_view ending);

/// Returns the first `bytes` decompressed bytes of a gzip file, or fewer.
using Unpack = std::function<std::string(const std::filesystem::path& file, std::size_t bytes)>;
/// Kind of a file by its first bytes, decompressed if it is a gzip file; nullopt for text, unknown content
/// and unreadable files.
std::optional<FileKind> file_kind_of(const std::filesystem::path& file, const Unpack& unpack);

Result<VolumeFile> inspect_nrrd(const std::filesystem::path& file, OtherFiles& others,
                                const PlacementOptions& placement_options);
Result<VolumeFile> inspect_nifti(const std::filesystem::path& file, OtherFiles& others,
                                 const PlacementOptions& placement_options);
Result<VolumeFile> inspect_metaimage(const std::filesystem::path& file, OtherFiles& others,
                                     const PlacementOptions& placement_options);

}  // namespace palpate::volume_io
