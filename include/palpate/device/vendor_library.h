#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/result.h"

/// Libraries of makers, which nobody may ship: found on the machine and asked for their functions when a
/// device is wanted, so that a build needs none of them.
namespace palpate {

/// Where a maker's library is looked for.
struct VendorLibraryPlace {
  /// The file itself, where the user says it. Empty: the names below, in the folders below.
  std::filesystem::path file;
  std::vector<std::string> names;              ///< of the file, the preferred one first
  std::vector<std::filesystem::path> folders;  ///< empty: system_library_folders()
};

/// Folders of the system's that its own loader looks into, and those that makers install to. The environment
/// (LD_LIBRARY_PATH) is not asked: who may set it could put another library under a hand.
std::vector<std::filesystem::path> system_library_folders();

/// The file that would be loaded: the first name that is in any folder.
/// Errors: kUnavailable, naming the file that the user gave or every name and folder.
/// @param whose  "OpenHaptics", for the error; `get` says where to get it
Result<std::filesystem::path> find_vendor_library(const VendorLibraryPlace& place, const std::string& whose,
                                                  const std::string& get);

/// A function of a library's, and where its address goes.
struct VendorFunction {
  const char* name;
  void** address;
  bool needed = true;
};

/// Loads a library, for good (some fail when they are loaded twice, so none is ever unloaded), and finds its
/// functions: all of them, and of those that are not needed nullptr for one that is missing.
/// Errors: kUnavailable, with what the system's loader says or naming every needed function that is missing.
Result<void> load_vendor_library(const std::filesystem::path& file, std::span<const VendorFunction> functions,
                                 const std::string& whose);

}  // namespace palpate
