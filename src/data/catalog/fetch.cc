#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <ctime>
#include <utility>

#include "catalog/fetch_files.h"
#include "catalog/local_data.h"
#include "palpate/base/file.h"
#include "palpate/base/output.h"
#include "palpate/catalog/catalog.h"
#include "palpate/phantoms/phantoms.h"
#include "palpate/volume_io/volume_io.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

Result<void> check_options(const FetchOptions& options) {
  const auto wrong = [](const char* what, const char* where, const char* remedy) {
    return Error{ErrorKind::kUsage, what, where, remedy};
  };
  if (options.voxel_mm && !(*options.voxel_mm >= 0.2 && *options.voxel_mm <= 3.0))
    return wrong("the phantom's voxels are 0.2 to 3 mm wide", "--voxel", "the default is 0.6");
  if (options.attempts < 1 || options.attempts > 100)
    return wrong("the attempts are 1 to 100", "attempts", "the default is 4");
  if (!(options.stall_timeout_s > 0)) return wrong("the stall timeout is above 0 s", "stall_timeout_s", "");
  if (!options.mirror.empty() && !options.mirror.starts_with("https://") &&
      !options.mirror.starts_with("http://"))
    return wrong("the address of a mirror begins with https:// or http://", "--mirror", "");
  return {};
}

constexpr std::string_view kWorkFolder = ".palpate-XXXXXX";

// Folder for incomplete files, inside the target folder so that renaming stays on one file system. Locked
// during the lifetime of its process (flock), so that a later process recognises what a killed one has left.
class WorkFolder {
 public:
  static Result<WorkFolder> create(const fs::path& parent) {
    sweep(parent);
    std::string pattern = (parent / kWorkFolder).string();
    if (::mkdtemp(pattern.data()) == nullptr) return output_error(parent, errno);
    return WorkFolder(pattern);
  }
  WorkFolder(WorkFolder&& other) noexcept
      : path_(std::exchange(other.path_, {})),
        lock_(std::exchange(other.lock_, -1)),
        unfinished_(std::move(other.unfinished_)) {}
  WorkFolder& operator=(WorkFolder&&) = delete;
  ~WorkFolder() {
    std::error_code ignored;
    if (!path_.empty()) fs::remove_all(path_, ignored);
    if (lock_ >= 0) ::close(lock_);
  }
  const fs::path& path() const { return path_; }

 private:
  explicit WorkFolder(fs::path path) : path_(std::move(path)), lock_(locked(path_)), unfinished_(path_) {}

  // -1: locked by another process, not a folder, or a file system without locks
  static int locked(const fs::path& folder) {
    const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
    if (descriptor < 0 || ::flock(descriptor, LOCK_EX | LOCK_NB) == 0) return descriptor;
    ::close(descriptor);
    return -1;
  }
  static void sweep(const fs::path& parent) {
    // a younger folder may not be locked yet
    constexpr std::time_t kMin_s = 60;
    constexpr std::size_t kPrefix = kWorkFolder.find('X');
    std::error_code failed;
    fs::directory_iterator entry(parent, failed);
    for (; !failed && entry != fs::directory_iterator(); entry.increment(failed)) {
      const std::string name = entry->path().filename().string();
      if (name.size() != kWorkFolder.size() || !name.starts_with(kWorkFolder.substr(0, kPrefix))) continue;
      struct stat status {};
      const int lock = locked(entry->path());
      if (lock < 0) continue;
      std::error_code ignored;
      if (::fstat(lock, &status) == 0 && status.st_uid == ::geteuid() &&
          status.st_mtime + kMin_s < std::time(nullptr))
        fs::remove_all(entry->path(), ignored);
      ::close(lock);
    }
  }

  fs::path path_;
  int lock_;
  UnfinishedFolder unfinished_;
};

// true if the phantom in `folder` has this voxel size; its name determines everything else
bool has_phantom(const CatalogEntry& entry, const fs::path& folder, const Eigen::Vector3d& spacing_mm) {
  const auto labels = read_header(folder / file_for(entry, DataRole::kLabels).name);
  const auto scan = read_header(folder / file_for(entry, DataRole::kScan).name);
  return labels && scan && labels->geometry.same_grid(scan->geometry) &&
         (labels->geometry.spacing_mm - spacing_mm).cwiseAbs().maxCoeff() < 1e-6;
}

Result<void> generate(const CatalogEntry& entry, const fs::path& folder, std::optional<double> voxel_mm,
                      const Progress& progress) {
  auto parameters = parse_phantom(entry.name);
  if (!parameters) return parameters.error();
  Eigen::Vector3d& spacing_mm =
      std::visit([](auto& p) -> Eigen::Vector3d& { return p.settings.spacing_mm; }, *parameters);
  if (voxel_mm) spacing_mm.setConstant(*voxel_mm);
  if (has_phantom(entry, folder, spacing_mm)) return {};
  const auto work = WorkFolder::create(folder);
  if (!work) return work.error();
  const auto phantom = make_phantom(*parameters, progress);
  if (!phantom) return phantom.error();

  // both files are written before either appears
  const std::string labels = file_for(entry, DataRole::kLabels).name;
  const std::string scan = file_for(entry, DataRole::kScan).name;
  if (const auto written = write_labels(work->path() / labels, phantom->labels); !written) return written;
  if (const auto written = write_volume(work->path() / scan, phantom->scan); !written) return written;
  if (progress.stopped()) return Progress::interrupted();
  for (const auto& name : {labels, scan}) {
    std::error_code failed;
    fs::rename(work->path() / name, folder / name, failed);
    if (failed) return output_error(folder / name, failed.value());
  }
  return {};
}

}  // namespace

Result<LocalData> fetch(const std::string& name, const FetchOptions& options, const Progress& progress,
                        const Warn& warn) {
  const auto found = entry_with_parameters(name);
  if (!found) return found.error();
  const CatalogEntry& entry = *found;
  if (const auto checked = check_options(options); !checked) return checked.error();

  // data installed by others are only referenced; the user's own copy may still lack optional files
  if (entry.source == DataSource::kPackage) return locate(name);
  if (options.voxel_mm && (entry.source != DataSource::kGenerated || name.find(':') != std::string::npos))
    return Error{ErrorKind::kUsage, "is only for a phantom without parameters", "--voxel",
                 "with parameters, give the voxel size among them: knee-phantom:side=right,spacing=0.4"};
  const fs::path own_folder = user_data_folder() / file_stem(entry.name);
  if (entry.source == DataSource::kFetched && options.into.empty())
    if (auto here = locate(name); here && here->labels.parent_path() != own_folder) return here;

  const fs::path folder = options.into.empty() ? own_folder : options.into;
  std::error_code failed;
  const bool new_folder = fs::create_directories(folder, failed);
  if (failed) return output_error(folder, failed.value());
  const auto done = entry.source == DataSource::kGenerated
                        ? generate(entry, folder, options.voxel_mm, progress)
                        : fetch_files(entry, folder, options, progress, warn);
  if (!done) {
    // removes the folder only if it is empty: a partial file is kept for resuming
    if (new_folder) fs::remove(folder, failed);
    return done.error();
  }
  const auto data = local_data_in(entry, folder);
  if (!data) return data.error();
  if (!*data)
    return Error{ErrorKind::kOutput, "its files were removed while it was fetched", folder.string(),
                 "try again"};
  return **data;
}

}  // namespace palpate
