#include <algorithm>

#include "palpate/contact/proxy.h"

namespace palpate {

RotatedTool::RotatedTool(std::span<const ToolSphere> spheres, const Eigen::Quaterniond& from,
                         const Eigen::Quaterniond& to)
    : count_(spheres.size()) {
  PALPATE_CHECK(count_ <= kMaxToolSpheres);
  std::copy(spheres.begin(), spheres.end(), spheres_.begin());
  if (from.coeffs() == to.coeffs()) return;
  const Eigen::Matrix3d turn = (to * from.conjugate()).toRotationMatrix();
  for (std::size_t k = 0; k < count_; ++k) {
    spheres_[k].offset_mm = Vector<Patient>(turn * spheres[k].offset_mm.eigen());
    spheres_[k].axis_mm = Vector<Patient>(turn * spheres[k].axis_mm.eigen());
  }
}

}  // namespace palpate
