#include "palpate/geometry/geometry.h"

namespace palpate::internal {

template <int bytes>
bool CompiledWithEigenTypesAlignedTo<bytes>::as_the_library_was() noexcept {
  return true;
}
template struct CompiledWithEigenTypesAlignedTo<EIGEN_MAX_STATIC_ALIGN_BYTES>;

}  // namespace palpate::internal
