#pragma once

#include <string>

namespace palpate::volume_io {

/// Reason for which DICOM files or images cannot be used.
struct Fault {
  std::string what;    ///< As in Error::what.
  std::string remedy;  ///< An imperative, as in Error::remedy.
};

}  // namespace palpate::volume_io
