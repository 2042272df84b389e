#include <gtest/gtest.h>

#include "palpate/base/hash.h"
#include "sampling/test_oracles.h"

// Single-point queries are bit-identical on every SIMD target and in every build, which replay of recorded
// runs relies on. These hashes change only when a method does.

namespace palpate {
namespace {

/// Pseudo-random numbers that do not depend on a library's distributions.
class Numbers {
 public:
  std::uint32_t next() {
    state_ = state_ * 6364136223846793005u + 1442695040888963407u;
    return static_cast<std::uint32_t>(state_ >> 33);
  }
  /// Coordinate of -3 ... 13 voxels, in steps of 2^-27.
  double coordinate() { return next() / 134217728.0 - 3; }

 private:
  std::uint64_t state_ = 42;
};

GridGeometry grid() {
  GridGeometry grid;
  grid.dims = {11, 10, 9};
  grid.spacing_mm = {0.625, 0.75, 0.9};
  grid.direction << 0.6, -0.8, 0, 0.8, 0.6, 0, 0, 0, -1;
  grid.origin = Point<Patient>(-12.5, 40.1, 7.3);
  return grid;
}

template <class T>
Volume<T> volume(Numbers& numbers) {
  Volume<T> result(grid());
  for (T& voxel : result.voxels()) voxel = static_cast<T>(numbers.next() >> 3);
  return result;
}

/// Hash of 2000 samples on each target; fails if two targets differ.
template <class Sample>
std::uint64_t hash_of(const Sample& sample) {
  std::uint64_t common = 0;
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    const test::OnlyTargets only(target);
    Numbers numbers;
    std::uint64_t hash = kHashSeed;
    for (int n = 0; n < 2000; ++n) {
      const double x = numbers.coordinate(), y = numbers.coordinate(), z = numbers.coordinate();
      const FieldSample s = sample(grid().X_PatientVoxel() * Point<Voxel>(x, y, z));
      for (const double number : {s.value, s.gradient.x(), s.gradient.y(), s.gradient.z()}) {
        hash_double(hash, number);
      }
    }
    hash = hash_finish(hash);
    EXPECT_TRUE(common == 0 || common == hash) << hwy::TargetName(target);
    common = hash;
  }
  return common;
}

TEST(GoldenBits, CentralDifferences) {
  Numbers numbers;
  const Field bytes(volume<std::uint8_t>(numbers)), words(volume<std::uint16_t>(numbers));
  const SignedField steps(volume<std::int16_t>(numbers), {.scale = 1e-3, .offset = 0.5, .outside = 77});
  const auto hash = [](const auto& field) {
    return hash_of([&](const Point<Patient>& p) { return sample_central_differences(field, p); });
  };
  EXPECT_EQ(hash(bytes), 8777700365394028984u);
  EXPECT_EQ(hash(words), 14252566605424715523u);
  EXPECT_EQ(hash(steps), 1656958324971393942u);
}

TEST(GoldenBits, Spline) {
  Numbers numbers;
  const Field bytes(volume<std::uint8_t>(numbers));
  for (const auto& [storage, golden] : {std::pair{SplineStorage::kInt16, 12748580624765092334u},
                                        {SplineStorage::kFloat, 13319309230165072388u}}) {
    const SplineField field(bytes, {.storage = storage, .threads = 2});
    EXPECT_EQ(hash_of([&](const Point<Patient>& p) { return sample_spline(field, p); }), golden);
  }
}

}  // namespace
}  // namespace palpate
