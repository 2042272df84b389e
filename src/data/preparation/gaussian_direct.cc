#include "preparation/gaussian_direct.h"

#include <bit>

#include "preparation/gaussian_slice.h"

namespace palpate::internal {

namespace {

// non-zero for a non-zero voxel; -0.0 counts as zero
std::uint8_t occupancy(std::uint8_t voxel) {
  return voxel;
}
std::uint32_t occupancy(float voxel) {
  return std::bit_cast<std::uint32_t>(voxel) << 1;
}

/// Whether each row (k * ny + j) of the volume has a non-zero voxel.
template <class In>
std::vector<std::uint8_t> occupied_rows(const Volume<In>& volume) {
  const auto length = static_cast<std::size_t>(volume.geometry().dims[0]);
  std::vector<std::uint8_t> occupied(volume.voxels().size() / length);
  const In* voxel = volume.voxels().data();
  for (std::uint8_t& row : occupied) {
    // combined by bitwise or, which compilers vectorise
    decltype(occupancy(In{})) any = 0;
    for (std::size_t i = 0; i < length; ++i) any |= occupancy(voxel[i]);
    row = any != 0 ? 1 : 0;
    voxel += length;
  }
  return occupied;
}

}  // namespace

template <class In, class Out>
Result<Volume<Out>> smooth_direct(const Volume<In>& volume, const std::array<double, 3>& sigma_voxels,
                                  int threads, const Progress& progress, const ProgressSpan& span) {
  const GridGeometry& grid = volume.geometry();
  Volume<Out> smooth(grid);
  if (volume.empty()) return smooth;

  SmoothingInput<In> input{&volume, occupied_rows(volume), {}};
  for (int axis = 0; axis < 3; ++axis) {
    input.kernels[axis] = sample_gaussian(sigma_voxels[axis], grid.dims[axis] - 1);
  }
  const int workers = worker_count(threads, grid.dims[2]);
  std::vector<SliceSmoother<In>> smoothers;
  for (int worker = 0; worker < workers; ++worker) smoothers.emplace_back(input);

  const auto done = for_each_slice(grid.dims[2], workers, progress, span, [&](int worker, int k) {
    smoothers[worker].smooth(k, smooth.voxels().data() + grid.offset(0, 0, k));
  });
  if (!done) return done.error();
  return smooth;
}

template Result<Volume<std::uint8_t>> smooth_direct(const Volume<std::uint8_t>&, const std::array<double, 3>&,
                                                    int, const Progress&, const ProgressSpan&);
template Result<Volume<std::uint16_t>> smooth_direct(const Volume<std::uint8_t>&,
                                                     const std::array<double, 3>&, int, const Progress&,
                                                     const ProgressSpan&);
template Result<Volume<float>> smooth_direct(const Volume<std::uint8_t>&, const std::array<double, 3>&, int,
                                             const Progress&, const ProgressSpan&);
template Result<Volume<float>> smooth_direct(const Volume<float>&, const std::array<double, 3>&, int,
                                             const Progress&, const ProgressSpan&);

}  // namespace palpate::internal
