#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "base/test_files.h"
#include "palpate/navigation/surface_registration.h"
#include "palpate/phantoms/phantoms.h"
#include "palpate/surfaces/surfaces.h"
#include "palpate/volume_io/volume_io.h"

/// Surface registration of bones of two knees from points traced by a tracked pointer: converges from ten
/// degrees and ten millimetres away, also with tremor, and rejects the mirrored bone.
namespace palpate {
namespace {

constexpr unsigned kSeed = 11;
constexpr std::size_t kTraced = 100;
constexpr int kStarts = 6;

class Traces {
 public:
  Traces(const LabelMap& labels, const std::string& name) : random_(kSeed) {
    const auto segment = std::ranges::find_if(
        labels.segments, [&](const Segment& each) { return each.name.find(name) != std::string::npos; });
    PALPATE_CHECK(segment != labels.segments.end());
    const auto prepared = prepare_surfaces(
        *label_bricks(labels.layers[static_cast<std::size_t>(segment->layer)]), {segment->value}, {});
    PALPATE_CHECK(prepared.ok());
    surface_ = prepared->front().surface;
    // places all over it: down the distance from voxels near it
    const Volume<float> values = surface_.distance_field().values();
    const GridGeometry& grid = values.geometry();
    std::vector<Point<Patient>> near;
    for (int k = 0; k < grid.dims[2]; ++k)
      for (int j = 0; j < grid.dims[1]; ++j)
        for (int i = 0; i < grid.dims[0]; ++i)
          if (std::abs(values.at(i, j, k)) < 0.4)
            near.push_back(grid.X_PatientVoxel() * Point<Voxel>(i, j, k));
    PALPATE_CHECK(near.size() > kTraced);
    while (points_.size() < kTraced) {
      Point<Patient> x = near[random_() % near.size()];
      for (int turn = 0; turn < 20; ++turn) {
        const FieldSample here = sample_central_differences(surface_.distance_field(), x);
        x = x - here.gradient.normalized() * here.value;
      }
      if (std::abs(surface_.distance_mm(x)) < 0.01) points_.push_back(x);
    }
  }

  struct Case {
    Transform<Patient, Tracker> truth, start;
    std::vector<Point<Tracker>> touched;
  };
  Case away(double noise_mm, bool mirrored = false) {
    Case out;
    out.truth = {Eigen::AngleAxisd(2.5, normal().normalized()).toRotationMatrix(), 300 * normal()};
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    for (const auto& point : points_) centre += point.eigen() / static_cast<double>(kTraced);
    // about the bone itself: elsewhere ten degrees are many millimetres
    const Eigen::Matrix3d turned =
        Eigen::AngleAxisd(std::numbers::pi / 18, normal().normalized()).toRotationMatrix();
    out.start = Transform<Patient, Patient>(turned, centre - turned * centre + 10 * normal().normalized()) *
                out.truth;
    for (Point<Patient> position : points_) {
      if (mirrored) position = {2 * centre.x() - position.x(), position.y(), position.z()};
      out.touched.push_back(out.truth.inverse() * (position + Vector<Patient>(noise_mm * normal())));
    }
    return out;
  }
  const Surface& surface() const { return surface_; }

 private:
  Eigen::Vector3d normal() {
    std::normal_distribution<double> one;
    const double x = one(random_), y = one(random_), z = one(random_);
    return {x, y, z};
  }
  std::mt19937 random_;
  Surface surface_;
  std::vector<Point<Patient>> points_;
};

enum class Mirrored { kRefused, kNotReported };
void expect_found_again(const LabelMap& labels, const std::string& name, Mirrored mirrored) {
  SCOPED_TRACE(name + ", seed " + std::to_string(kSeed));
  Traces traces(labels, name);
  double max_mm = 0, max_shaken_mm = 0;
  for (int n = 0; n < kStarts; ++n)
    for (const double noise_mm : {0.0, 0.3}) {
      const Traces::Case of = traces.away(noise_mm);
      const auto found = register_to_surface(traces.surface(), of.touched, of.start);
      ASSERT_TRUE(found) << found.error().message();
      double& largest = noise_mm > 0 ? max_shaken_mm : max_mm;
      for (const Point<Tracker>& point : of.touched)
        largest = std::max(largest, (found->patient_from_tracker * point - of.truth * point).norm());
    }
  std::printf("  %s: at most %.3f mm off, %.3f by a hand that shakes by 0.3 mm\n", name.c_str(), max_mm,
              max_shaken_mm);
  EXPECT_LT(max_mm, 0.2);
  EXPECT_LT(max_shaken_mm, 0.6);
  for (int n = 0; n < kStarts && mirrored == Mirrored::kRefused; ++n) {
    const Traces::Case of = traces.away(0, true);
    EXPECT_FALSE(register_to_surface(traces.surface(), of.touched, of.start)) << "the other side's, " << n;
  }
}

TEST(Knees, BonesOfTheGeneratedOneAreFoundAgain) {
  const auto phantom = make_knee_phantom(1.2);
  ASSERT_TRUE(phantom.ok());
  // within a millimetre they are their own mirror images
  for (const char* bone : {"tibia", "femur"})
    expect_found_again(phantom->labels, bone, Mirrored::kNotReported);
}

TEST(Knees, BonesOfAHandSegmentedOneAreFoundAgain) {
  PALPATE_SHARED_FILE(file, "knee_spl/seg.nrrd");
  PALPATE_SHARED_FILE(names, "knee_spl/knee.ctbl");
  const auto read = read_labels(file, names);
  ASSERT_TRUE(read.ok()) << read.error().message();
  for (const char* bone : {"tibia", "femur"}) expect_found_again(read->labels, bone, Mirrored::kRefused);
}

}  // namespace
}  // namespace palpate
