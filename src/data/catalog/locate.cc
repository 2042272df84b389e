#include <pwd.h>
#include <unistd.h>

#include <cstdlib>

#include "catalog/download.h"
#include "catalog/label_names.h"
#include "catalog/local_data.h"
#include "palpate/catalog/catalog.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

// volumes of Debian's mricron-data
constexpr const char* kPackageFolder = "/usr/share/mricron/templates";

std::string environment(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

fs::path home_folder() {
  if (const std::string home = environment("HOME"); !home.empty()) return home;
  const passwd* user = ::getpwuid(::getuid());
  return user != nullptr && user->pw_dir != nullptr ? user->pw_dir : ".";
}

Error absent(const CatalogEntry& entry) {
  Error error{ErrorKind::kUnavailable, "this data set is not on this machine", entry.name, ""};
  error.remedy = entry.source == DataSource::kPackage ? "apt-get install " + entry.home + " installs it"
                                                      : "palpate data fetch " + entry.name + " fetches it";
  return error;
}

}  // namespace

std::filesystem::path user_data_folder() {
  const fs::path base = environment("XDG_DATA_HOME");
  // the XDG specification ignores relative paths
  return (base.is_absolute() ? base : home_folder() / ".local" / "share") / "palpate";
}

std::vector<std::filesystem::path> data_folders() {
  std::vector<fs::path> folders;
  std::string list = environment("PALPATE_DATA");
  while (!list.empty()) {
    const auto end = std::min(list.find(':'), list.size());
    if (end > 0) folders.emplace_back(list.substr(0, end));
    list.erase(0, end + 1);
  }
  folders.push_back(user_data_folder());
  folders.emplace_back(kPackageFolder);
  return folders;
}

Result<std::optional<LocalData>> local_data_in(const CatalogEntry& entry,
                                               const std::filesystem::path& folder) {
  std::error_code ignored;
  for (const auto& file : entry.files)
    if (file.required && !fs::is_regular_file(folder / file.name, ignored)) return std::optional<LocalData>{};

  LocalData data;
  for (const auto& file : entry.files) {
    const fs::path path = folder / file.name;
    if (!fs::is_regular_file(path, ignored)) continue;
    if (const auto checked = check_content(path, file.bytes, file.sha256, file.git_blob); !checked)
      return checked.error();
    switch (file.role) {
      case DataRole::kLabels:
        data.labels = path;
        break;
      case DataRole::kScan:
        data.scan = path;
        break;
      case DataRole::kNames:
        data.names = path;
        break;
    }
  }
  if (entry.source == DataSource::kPackage) {
    // its names have a format of their own
    const fs::path table = user_data_folder() / entry.name / "names.tsv";
    if (const auto stored = update_names_table(*data.names, table); !stored) return stored.error();
    data.names = table;
  }
  return std::optional(data);
}

Result<LocalData> locate(const std::string& name) {
  const auto entry = entry_with_parameters(name);
  if (!entry) return entry.error();
  // a damaged copy is reported only if no valid one is found in a later folder
  std::optional<Error> damaged;
  for (const auto& folder : data_folders()) {
    for (const auto& candidate : {folder / entry->folder_hint, folder / entry->name, folder}) {
      auto data = local_data_in(*entry, candidate);
      if (data && *data) return std::move(**data);
      if (!data && !damaged) damaged = data.error();
    }
  }
  return damaged ? *damaged : absent(*entry);
}

}  // namespace palpate
