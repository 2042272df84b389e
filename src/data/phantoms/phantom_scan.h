#pragma once

#include <cstdint>

#include "phantoms/phantom_plan.h"

namespace palpate {

/// Intensity of air.
double background(PhantomImaging imaging);

/// Depth below a part's surface within which its intensity varies (the cortical rim of a bone); mm.
double material_depth_mm(PhantomMaterial material);

/// Intensity of a voxel after a part is painted. A surface within half a voxel of the centre yields partial
/// volume.
/// @param below        intensity before
/// @param distance_mm  signed distance of the voxel's centre from the part's surface
double paint(PhantomMaterial material, PhantomImaging imaging, double below, double distance_mm,
             double voxel_mm);

/// Factor of the coil's smooth shading in MR, about 1; 1 for CT.
double shading(PhantomImaging imaging, const Eigen::Vector3d& p_mm);

/// Replaces a slice by the magnitude of a complex signal with Gaussian noise of `sigma` in both channels
/// (Rician noise). Deterministic for each seed and slice, in any order of slices.
void add_rician_noise(float* voxels, std::size_t count, double sigma, std::uint64_t seed, int slice);
/// Adds Gaussian noise of `sigma`, deterministic for each seed and slice.
void add_gaussian_noise(float* voxels, std::size_t count, double sigma, std::uint64_t seed, int slice);
/// Adds noise of the kind and strength of the imaging method.
void add_noise(PhantomImaging imaging, float* voxels, std::size_t count, std::uint64_t seed, int slice);

}  // namespace palpate
