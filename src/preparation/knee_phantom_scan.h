#pragma once

#include <cstdint>

#include "preparation/knee_phantom_anatomy.h"

namespace palpate {

/// How deep below a part's surface its intensity still changes (the cortical rim of a bone), mm.
double material_depth_mm(PhantomMaterial material);

/// What a voxel shows once a part covers it: `below` is what it showed before, `distance_mm` the signed
/// distance of its centre from the part's surface. A surface within half a voxel of the centre covers it
/// partially.
double paint(PhantomMaterial material, double below, double distance_mm, double voxel_mm);

/// A receive coil's smooth shading, about 1.
double coil_sensitivity(const Eigen::Vector3d& p_mm);

/// Makes a slice the magnitude of a complex signal with Gaussian noise of `sigma` in both channels (Rician).
/// The same numbers for the same seed and slice, in any order of slices.
void add_rician_noise(float* voxels, std::size_t count, double sigma, std::uint64_t seed, int slice);

}  // namespace palpate
