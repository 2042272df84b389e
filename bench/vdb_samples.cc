#include <nanovdb/NanoVDB.h>
#include <nanovdb/util/OpenToNanoVDB.h>
#include <nanovdb/util/SampleFromVoxels.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Dense.h>
#include <openvdb/tools/Interpolation.h>

#include <algorithm>

#include "entrant.h"

namespace palpate::bench {

namespace {

/// Seven interpolations through an accessor by index: value(i, j, k).
template <class Value>
FieldSample seven(const SampledWork& work, const Point<Patient>& p, const Value& value) {
  const Point<Voxel> at = work.X_VoxelPatient * p;
  const double x = at.x(), y = at.y(), z = at.z();
  const Eigen::Vector3d per_voxel(0.5 * (value(x + 1, y, z) - value(x - 1, y, z)),
                                  0.5 * (value(x, y + 1, z) - value(x, y - 1, z)),
                                  0.5 * (value(x, y, z + 1) - value(x, y, z - 1)));
  return {value(x, y, z), Vector<Patient>(work.gradient_map * per_voxel)};
}

/// Sparse grid as usual in OpenVDB: blocks of zeros are not stored.
openvdb::FloatGrid::Ptr to_grid(const Volume<std::uint8_t>& volume) {
  const auto& dims = volume.geometry().dims;
  openvdb::tools::Dense<float, openvdb::tools::LayoutXYZ> dense(
      openvdb::CoordBBox(0, 0, 0, dims[0] - 1, dims[1] - 1, dims[2] - 1));
  std::transform(volume.voxels().begin(), volume.voxels().end(), dense.data(),
                 [](std::uint8_t byte) { return static_cast<float>(byte) / 255; });
  const auto grid = openvdb::FloatGrid::create(0);
  openvdb::tools::copyFromDense(dense, *grid, 0.f);
  return grid;
}

}  // namespace

std::vector<Entrant> vdb_entrants(const std::shared_ptr<const SampledWork>& work) {
  openvdb::initialize();
  const openvdb::FloatGrid::Ptr grid = to_grid(work->bytes);
  using Accessor = openvdb::FloatGrid::ConstAccessor;
  const auto accessor = std::make_shared<Accessor>(grid->getConstAccessor());

  using Handle = nanovdb::GridHandle<nanovdb::HostBuffer>;
  const auto handle = std::make_shared<Handle>(nanovdb::openToNanoVDB(*grid));
  using NanoAccessor = nanovdb::FloatGrid::AccessorType;
  const auto nano = std::make_shared<NanoAccessor>(handle->grid<float>()->getAccessor());
  using Nano = nanovdb::SampleFromVoxels<NanoAccessor, 1, false>;

  return {entrant("OpenVDB BoxSampler, seven samples",
                  [=, keep = grid](const Point<Patient>& p) {
                    return seven(*work, p, [&](double x, double y, double z) {
                      float value = 0;
                      openvdb::tools::BoxSampler::sample(*accessor, openvdb::Vec3d(x, y, z), value);
                      return static_cast<double>(value);
                    });
                  }),
          entrant("NanoVDB trilinear, seven samples",
                  [=, keep = handle](const Point<Patient>& p) {
                    const Nano sampler(*nano);
                    return seven(*work, p, [&](double x, double y, double z) {
                      return static_cast<double>(sampler(nanovdb::Vec3<double>(x, y, z)));
                    });
                  }),
          entrant(
              "NanoVDB trilinear + its derivative",
              [=, keep = handle](const Point<Patient>& p) {
                const Nano sampler(*nano);
                const Point<Voxel> x = work->X_VoxelPatient * p;
                const nanovdb::Vec3<double> at(x.x(), x.y(), x.z());
                const nanovdb::Vec3<float> g = sampler.gradient(at);
                return FieldSample{static_cast<double>(sampler(at)),
                                   Vector<Patient>(work->gradient_map * Eigen::Vector3d(g[0], g[1], g[2]))};
              },
              // the derivative of the interpolant itself, which is discontinuous between cells
              Compared::kValue)};
}

}  // namespace palpate::bench
