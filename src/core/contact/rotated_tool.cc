#include <algorithm>

#include "palpate/contact/proxy.h"

namespace palpate {

RotatedTool::RotatedTool(std::span<const ToolPart> parts, const Eigen::Quaterniond& from,
                         const Eigen::Quaterniond& to)
    : count_(parts.size()) {
  PALPATE_CHECK(count_ <= kMaxToolParts);
  std::copy(parts.begin(), parts.end(), parts_.begin());
  if (from.coeffs() == to.coeffs()) return;
  const Eigen::Matrix3d turn = (to * from.conjugate()).toRotationMatrix();
  for (std::size_t k = 0; k < count_; ++k) {
    parts_[k].offset_mm = Vector<Patient>(turn * parts[k].offset_mm.eigen());
    parts_[k].axis_mm = Vector<Patient>(turn * parts[k].axis_mm.eigen());
  }
}

}  // namespace palpate
