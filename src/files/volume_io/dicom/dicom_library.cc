#include <dlfcn.h>

#include <string>

#include "volume_io/dicom/dicom_library.h"

namespace palpate::volume_io {
namespace {

constexpr const char* kDicomLibrary = "libpalpate_dicom.so";

Result<DicomLibrary*> open_dicom_library() {
  const auto missing = [] {
    const char* why = ::dlerror();
    return Error{ErrorKind::kUnavailable,
                 "DICOM cannot be read: " + std::string(why ? why : "its library is of another version"), "",
                 std::string("install palpate again, with ") + kDicomLibrary + " and DCMTK (libdcmtk17)"};
  };
  void* library = ::dlopen(kDicomLibrary, RTLD_NOW | RTLD_LOCAL);
  if (!library) return missing();
  const auto entry_point =
      reinterpret_cast<decltype(&palpate_dicom_library)>(::dlsym(library, "palpate_dicom_library"));
  if (!entry_point) return missing();
  return entry_point();
}

}  // namespace

Result<DicomLibrary*> load_dicom_library() {
  static const Result<DicomLibrary*> library = open_dicom_library();
  return library;
}

}  // namespace palpate::volume_io
