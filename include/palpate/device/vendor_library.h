#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/result.h"

/// Vendors' libraries, which may not be redistributed: located on the machine and loaded at run time when a
/// device is used, so that a build needs none of them.
namespace palpate {

/// Search location of a vendor's library.
struct VendorLibraryLocation {
  /// The file itself, if the user specifies it. Empty: `names` are searched for in `folders`.
  std::filesystem::path file;
  std::vector<std::string> names;              ///< File names, the preferred one first
  std::vector<std::filesystem::path> folders;  ///< Empty: system_library_folders()
};

/// Folders that the system's loader searches and to which vendors install. The environment (LD_LIBRARY_PATH)
/// is ignored, because whoever can set it could substitute a library that drives a physical device.
std::vector<std::filesystem::path> system_library_folders();

/// File that would be loaded: the first of the names that exists in any folder.
/// Errors: kUnavailable, naming the user's file or every name and folder.
/// @param product  product name for the error, e.g. "OpenHaptics"
/// @param remedy   remedy for the error: where to obtain the library
Result<std::filesystem::path> find_vendor_library(const VendorLibraryLocation& location,
                                                  const std::string& product, const std::string& remedy);

/// A function of a library, and the pointer that receives its address.
struct VendorFunction {
  const char* name;
  void** address;
  bool needed = true;
};

/// Loads a library and resolves its functions. The library is never unloaded, because some fail when loaded a
/// second time. An optional function that is missing gets nullptr.
/// Errors: kUnavailable, with the system loader's message or naming every missing required function.
Result<void> load_vendor_library(const std::filesystem::path& file, std::span<const VendorFunction> functions,
                                 const std::string& product);

}  // namespace palpate
