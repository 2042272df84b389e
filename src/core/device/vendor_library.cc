#include "palpate/device/vendor_library.h"

#include <dlfcn.h>

#include <system_error>

#include "palpate/base/printable.h"

namespace palpate {

std::vector<std::filesystem::path> system_library_folders() {
  return {
    "/usr/local/lib",
#if defined(__x86_64__)
        "/usr/lib/x86_64-linux-gnu", "/lib/x86_64-linux-gnu",
#elif defined(__aarch64__)
        "/usr/lib/aarch64-linux-gnu", "/lib/aarch64-linux-gnu",
#endif
        "/usr/lib", "/usr/lib64", "/lib", "/lib64"
  };
}

Result<std::filesystem::path> find_vendor_library(const VendorLibraryLocation& location,
                                                  const std::string& product, const std::string& remedy) {
  std::error_code ignored;
  if (!location.file.empty()) {
    // dlopen would search for a bare name
    const auto file = std::filesystem::absolute(location.file, ignored);
    if (std::filesystem::is_regular_file(file, ignored)) return file;
    return Error{ErrorKind::kUnavailable, "there is no such file", printable_name(location.file.string()),
                 "name the file of " + product + "'s library, or leave it out to search for it"};
  }
  const auto folders = location.folders.empty() ? system_library_folders() : location.folders;
  std::string names, where;
  for (const std::string& name : location.names) {
    names += (names.empty() ? "" : " or ") + name;
    for (const auto& folder : folders)
      if (std::filesystem::is_regular_file(folder / name, ignored)) return folder / name;
  }
  for (const auto& folder : folders) where += (where.empty() ? "" : ", ") + folder.string();
  return Error{ErrorKind::kUnavailable, "no " + names + " is in " + where, product, remedy};
}

Result<void> load_vendor_library(const std::filesystem::path& file, std::span<const VendorFunction> functions,
                                 const std::string& product) {
  const std::string name = printable_name(file.string());
  void* const library = ::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!library) {
    const char* message = ::dlerror();
    return Error{ErrorKind::kUnavailable,
                 "cannot be loaded: " + printable(message ? message : "the system gives no reason"), name,
                 "install the missing library, or install " + product + " again"};
  }
  std::string missing;
  for (const VendorFunction& function : functions) {
    *function.address = ::dlsym(library, function.name);
    if (!*function.address && function.needed)
      missing += std::string(missing.empty() ? "" : ", ") + function.name;
  }
  if (!missing.empty())
    return Error{ErrorKind::kUnavailable, "does not have " + missing, name,
                 "it is another library or too old: install a newer " + product};
  return {};
}

}  // namespace palpate
