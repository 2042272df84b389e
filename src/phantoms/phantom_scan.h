#pragma once

#include <cstdint>

#include "phantoms/phantom_plan.h"

namespace palpate {

/// What a scan shows where nothing is.
double background(PhantomImaging imaging);

/// How deep below a part's surface its intensity still changes (the cortical rim of a bone), mm.
double material_depth_mm(PhantomMaterial material);

/// What a voxel shows once a part covers it: `below` is what it showed before, `distance_mm` the signed
/// distance of its centre from the part's surface. A surface within half a voxel of the centre covers it
/// partially.
double paint(PhantomMaterial material, PhantomImaging imaging, double below, double distance_mm,
             double voxel_mm);

/// Of MR a receive coil's smooth shading, about 1; of CT 1.
double shading(PhantomImaging imaging, const Eigen::Vector3d& p_mm);

/// Makes a slice the magnitude of a complex signal with Gaussian noise of `sigma` in both channels (Rician).
/// The same numbers for the same seed and slice, in any order of slices.
void add_rician_noise(float* voxels, std::size_t count, double sigma, std::uint64_t seed, int slice);
/// Adds Gaussian noise of `sigma`, likewise.
void add_gaussian_noise(float* voxels, std::size_t count, double sigma, std::uint64_t seed, int slice);
/// The one of these that the imaging has, as strong as it has it.
void add_noise(PhantomImaging imaging, float* voxels, std::size_t count, std::uint64_t seed, int slice);

}  // namespace palpate
