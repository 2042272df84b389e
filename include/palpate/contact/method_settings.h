#pragma once

#include "palpate/sampling/normal_encoding.h"

namespace palpate {

/// Settings of the force methods in a scene.
struct MethodSettings {
  double sphere_sigma_voxels = 1;  ///< Standard deviation of the Gaussian sphere in voxels, 0.5 ... 2
  /// Encoding of the stored-normals method.
  NormalEncoding normals = NormalEncoding::kBytes;
  /// Damping of the proxy's spring, in addition to the stiffness of each tissue.
  double coupling_damping_N_s_per_mm = 0;

  friend bool operator==(const MethodSettings&, const MethodSettings&) = default;
};

}  // namespace palpate
