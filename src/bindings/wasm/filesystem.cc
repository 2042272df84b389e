// The functions of std::filesystem that read: libc++ is built without them for WebAssembly. wasi-libc asks
// the page's JavaScript for the files that it was given.

#include <dirent.h>
#include <sys/stat.h>

#include <cerrno>
#include <filesystem>
#include <memory>
#include <system_error>
#include <utility>
#include <vector>

_LIBCPP_BEGIN_NAMESPACE_FILESYSTEM

namespace {

// sets `failed` from errno, or clears it
void report(error_code* failed, bool has_failed) {
  if (failed == nullptr) return;
  *failed = has_failed ? error_code(errno, generic_category()) : error_code();
}

// paths of the entries of one folder
vector<path> entries_of(const path& folder, error_code* failed) {
  vector<path> entries;
  DIR* const stream = ::opendir(folder.c_str());
  report(failed, stream == nullptr);
  if (stream == nullptr) return entries;
  while (const dirent* entry = ::readdir(stream)) {
    const string_view name = entry->d_name;
    if (name != "." && name != "..") entries.push_back(folder / name);
  }
  ::closedir(stream);
  return entries;
}

}  // namespace

file_status __status(const path& file, error_code* failed) {
  struct stat status {};
  const bool is_missing = ::stat(file.c_str(), &status) != 0;
  report(failed, is_missing);
  if (is_missing)
    return file_status(errno == ENOENT || errno == ENOTDIR ? file_type::not_found : file_type::none);
  return file_status(S_ISREG(status.st_mode)   ? file_type::regular
                     : S_ISDIR(status.st_mode) ? file_type::directory
                                               : file_type::unknown);
}

uintmax_t __file_size(const path& file, error_code* failed) {
  struct stat status {};
  const bool has_failed = ::stat(file.c_str(), &status) != 0;
  report(failed, has_failed);
  return has_failed ? static_cast<uintmax_t>(-1) : static_cast<uintmax_t>(status.st_size);
}

bool __equivalent(const path& one, const path& other, error_code* failed) {
  struct stat first {
  }, second{};
  const bool has_failed = ::stat(one.c_str(), &first) != 0 || ::stat(other.c_str(), &second) != 0;
  report(failed, has_failed);
  return !has_failed && first.st_dev == second.st_dev && first.st_ino == second.st_ino;
}

// the current folder of a page is its only one
path __absolute(const path& file, error_code* failed) {
  report(failed, false);
  return path("/") / file;
}

// nothing is cached: each query asks anew
error_code directory_entry::__do_refresh() noexcept {
  __data_ = __cached_data();
  return {};
}

// ---- entries of a folder, read when the iteration begins

class __dir_stream {
 public:
  vector<directory_entry> entries;
  size_t at = 0;
};

directory_iterator::directory_iterator(const path& folder, error_code* failed, directory_options) {
  auto stream = make_shared<__dir_stream>();
  for (const path& entry : entries_of(folder, failed)) stream->entries.emplace_back(entry);
  if (!stream->entries.empty()) __imp_ = std::move(stream);
}

directory_iterator& directory_iterator::__increment(error_code* failed) {
  report(failed, false);
  if (++__imp_->at == __imp_->entries.size()) __imp_.reset();
  return *this;
}

const directory_entry& directory_iterator::__dereference() const {
  return __imp_->entries[__imp_->at];
}

struct recursive_directory_iterator::__shared_imp {
  vector<pair<directory_entry, int>> entries;  // with their depths
  size_t at = 0;

  void add(const path& folder, int depth, error_code* failed) {
    // the page's folder has none in it; readers search no deeper than this elsewhere
    constexpr int kMaxDepth = 4;
    if (depth > kMaxDepth) return;
    for (const path& entry : entries_of(folder, failed)) {
      entries.emplace_back(directory_entry(entry), depth);
      if (is_directory(__status(entry))) add(entry, depth + 1, nullptr);
    }
  }
};

recursive_directory_iterator::recursive_directory_iterator(const path& folder, directory_options,
                                                           error_code* failed)
    : __rec_(true) {
  auto all = make_shared<__shared_imp>();
  all->add(folder, 0, failed);
  if (!all->entries.empty()) __imp_ = std::move(all);
}

recursive_directory_iterator& recursive_directory_iterator::__increment(error_code* failed) {
  report(failed, false);
  if (++__imp_->at == __imp_->entries.size()) __imp_.reset();
  return *this;
}

const directory_entry& recursive_directory_iterator::__dereference() const {
  return __imp_->entries[__imp_->at].first;
}

int recursive_directory_iterator::depth() const {
  return __imp_->entries[__imp_->at].second;
}

_LIBCPP_END_NAMESPACE_FILESYSTEM
