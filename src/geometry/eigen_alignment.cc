#include "palpate/geometry/geometry.h"

namespace palpate::internal {

template <>
bool CompiledWithEigenTypesAlignedTo<EIGEN_MAX_STATIC_ALIGN_BYTES>::as_the_library_was() noexcept {
  return true;
}

}  // namespace palpate::internal
