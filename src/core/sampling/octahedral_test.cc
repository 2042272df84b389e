#include "sampling/octahedral.h"

#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <numbers>
#include <random>

#include "palpate/sampling/stored_normals.h"

namespace palpate {
namespace {

using internal::decode_octahedral;
using internal::encode_octahedral;
using internal::OctahedralCode;

constexpr unsigned kOctahedralSeed = 99;

Eigen::Vector3d random_direction(std::mt19937& random) {
  std::normal_distribution<double> normal;
  return Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
}

double angle_degrees(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * 180 / std::numbers::pi;
}

TEST(Octahedral, EveryCodeRoundTrips) {
  for (int a = -127; a <= 127; ++a) {
    for (int b = -127; b <= 127; ++b) {
      const Eigen::Vector3d n = decode_octahedral({a, b}, 127);
      ASSERT_NEAR(n.norm(), 1, 1e-12);
      // on the border of the square two codes have the same direction
      const Eigen::Vector3d again = decode_octahedral(encode_octahedral(n, 127), 127);
      ASSERT_LT((again - n).norm(), 1e-12) << a << " " << b;
    }
  }
}

TEST(Octahedral, EncodesTheNearestDirection) {
  SCOPED_TRACE("seed " + std::to_string(kOctahedralSeed));
  std::mt19937 random(kOctahedralSeed);
  const int levels = 15;
  for (int n = 0; n < 2000; ++n) {
    const Eigen::Vector3d direction = random_direction(random);
    double best = 180;
    for (int a = -levels; a <= levels; ++a) {
      for (int b = -levels; b <= levels; ++b) {
        best = std::min(best, angle_degrees(decode_octahedral({a, b}, levels), direction));
      }
    }
    const OctahedralCode code = encode_octahedral(direction, levels);
    // where the map is most distorted, the nearest code may not be among the four around the point
    ASSERT_LT(angle_degrees(decode_octahedral(code, levels), direction), 1.1 * best + 1e-9);
  }
}

TEST(Octahedral, AxesAreExact) {
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {-1.0, 1.0}) {
      const Vector<Patient> n(sign * Eigen::Vector3d::Unit(axis));
      for (const auto encoding :
           {NormalEncoding::kBytes, NormalEncoding::kOctahedral16, NormalEncoding::kOctahedral24}) {
        EXPECT_EQ(stored_normal(n, encoding), n);
      }
    }
  }
}

TEST(StoredNormal, ErrorsMatchTheDocumentedRatios) {
  SCOPED_TRACE("seed " + std::to_string(kOctahedralSeed));
  std::mt19937 random(kOctahedralSeed);
  const auto mean_error = [&](NormalEncoding encoding) {
    double sum = 0;
    const int count = 20000;
    for (int n = 0; n < count; ++n) {
      const Eigen::Vector3d direction = random_direction(random);
      sum += angle_degrees(stored_normal(Vector<Patient>(direction), encoding).eigen(), direction);
    }
    return sum / count;
  };
  const double bytes = mean_error(NormalEncoding::kBytes);
  const double oct16 = mean_error(NormalEncoding::kOctahedral16),
               oct24 = mean_error(NormalEncoding::kOctahedral24);
  std::cout << "mean error in degrees: 3 bytes " << bytes << ", octahedral 16 " << oct16 << ", octahedral 24 "
            << oct24 << "\n";
  EXPECT_NEAR(bytes, 0.170, 0.01);
  EXPECT_LT(oct24 * 5, bytes);
  EXPECT_LT(oct16, 2 * bytes);
  EXPECT_EQ(normal_bytes(NormalEncoding::kOctahedral24), normal_bytes(NormalEncoding::kBytes));
  EXPECT_EQ(3 * normal_bytes(NormalEncoding::kOctahedral16), 2 * normal_bytes(NormalEncoding::kBytes));
}

TEST(StoredNormal, ZeroVectorStaysZero) {
  for (const auto encoding :
       {NormalEncoding::kBytes, NormalEncoding::kOctahedral16, NormalEncoding::kOctahedral24}) {
    EXPECT_EQ(stored_normal(Vector<Patient>(), encoding), Vector<Patient>());
  }
}

}  // namespace
}  // namespace palpate
