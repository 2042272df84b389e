#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"

/// Data sets that anybody can have: generated, installed by a package, or fetched from their public
/// home with checked hashes.
namespace palpate {

/// What a file of a data set is for.
enum class DataRole : std::uint8_t { kLabels, kScan, kNames };

/// One file of a data set.
struct CatalogFile {
  DataRole role = DataRole::kLabels;
  std::string name{};                    ///< in the data set's folder
  std::string remote{};                  ///< path below the data set's public home; empty: not fetched
  std::optional<std::uint64_t> bytes{};  ///< size, where known
  std::string sha256{};                  ///< lower-case hex, or empty
  std::string git_blob{};                ///< git's object id (SHA-1 of "blob <size>\0<content>"), or empty
  bool required = true;                  ///< false: an extra (the MR image), its absence is a warning
};

/// How a data set comes onto a machine.
enum class DataSource : std::uint8_t {
  kGenerated,  ///< computed by palpate
  kFetched,    ///< downloaded from `home`
  kPackage,    ///< installed by the Debian package named in `home`
};

struct CatalogEntry {
  std::string name;  ///< "knee-phantom", "knee-atlas", "head", ...
  std::string summary;
  std::string licence;  ///< name and one line of what it asks
  DataSource source = DataSource::kFetched;
  std::string home;         ///< public URL, or the package; empty when generated
  std::string folder_hint;  ///< folder name looked for below each data folder ("knee_spl")
  std::vector<CatalogFile> files;
};

const std::vector<CatalogEntry>& catalog();
/// The data set of a name; a phantom's may have parameters, which are not looked at
/// (palpate/phantoms/phantoms.h). Error kBadInput that lists the known names.
Result<const CatalogEntry*> find_entry(const std::string& name);

/// Folders to look in, in order: PALPATE_DATA (a colon-separated list), then the user's data folder
/// ($XDG_DATA_HOME/palpate or ~/.local/share/palpate), then what packages install.
std::vector<std::filesystem::path> data_folders();
std::filesystem::path user_data_folder();

/// Where a data set's files are on this machine. Content is checked against the hashes that are known.
struct LocalData {
  std::filesystem::path labels;
  std::optional<std::filesystem::path> scan;
  std::optional<std::filesystem::path> names;
};
/// Errors: kUnavailable with how to get it (`palpate data fetch NAME`) when it is not here; kBadInput
/// naming both hashes when a file of the right name has the wrong content and no folder has the right one.
/// A phantom with parameters is there once it was fetched, in files that are named after them; errors of
/// parse_phantom().
/// For `head`, whose names come in a form of their own, a table of names is kept in the user's data folder.
Result<LocalData> locate(const std::string& name);

struct FetchOptions {
  std::filesystem::path into;  ///< default: user_data_folder()/NAME
  std::string mirror;          ///< base URL (http or https) in place of the public home; empty: the home
  /// Of a generated phantom without parameters, 0.2 ... 3; empty: its own default
  std::optional<double> voxel_mm;
  double stall_timeout_s = 20;  ///< give up an attempt (and resume) when nothing arrives for so long
  int attempts = 4;             ///< connections tried for one file, 1 ... 100
};
/// Fetches, resumes or generates a data set; every file appears whole and checked or not at all (a
/// partial download stays as NAME.part and is resumed). Files that are already right are kept, and
/// nothing is fetched at all when `into` is empty and the data set is found by locate(). The MR image of
/// knee-atlas is dropped with a warning when its grid is not the label map's. Returns where it now is.
/// Errors: kUnavailable (network, package, wrong content), kOutput, kUsage (options), kBadInput
/// (an unknown name, parameters of a phantom), kInterrupted.
Result<LocalData> fetch(const std::string& name, const FetchOptions& options, const Progress& progress = {},
                        const Warn& warn = {});

}  // namespace palpate
