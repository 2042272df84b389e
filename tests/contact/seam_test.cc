#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "base/test_chart.h"
#include "base/test_files.h"
#include "contact_body.h"
#include "palpate/contact/proxy.h"
#include "palpate/loading/loading.h"
#include "palpate/phantoms/phantoms.h"
#include "palpate/scene/scene.h"
#include "palpate/volume_io/volume_io.h"

/// Presses, slides and withdrawals where labels meet: on the flat top of two labels, and at random places of
/// whole knees and of a head, half of them at seams. PALPATE_TEST_PRESSES says how many on each.
namespace palpate {
namespace {

using namespace test;

constexpr unsigned kSeamSeed = 15;
constexpr double kPress_N = 1, kSlideMost_N = 3;
constexpr double kStep_mm = 0.02;  // 20 mm/s at 1 kHz
constexpr double kFar_mm = 12, kDeepest_mm = 6, kSlide_mm = 5, kWithdrawn_mm = 6, kOutside_mm = 0.05;
constexpr double kContact_mm = 0.5, kContact_N = 0.01;
constexpr double kJump_N = 0.02, kInward_N = 0.02, kFree_N = 0.001, kDrag_N = 0.05;
// after 1 mm (50 ms) in free space the slip has ended, and any remaining inward force is a fault
constexpr double kSlipOver_mm = 1;

int seam_presses() {
  const char* value = std::getenv("PALPATE_TEST_PRESSES");
  return value != nullptr ? std::atoi(value) : 400;
}

// the same model with a separate closed surface for each label, without common outer surfaces
Body with_separate_label_surfaces(const Model& model) {
  Body body{std::make_shared<const Model>(model), {}};
  for (std::size_t label = 1; label < model.tissue_of_label.size(); ++label) {
    Model alone = model;
    for (Tissue& tissue : alone.tissues) tissue.touchable = false;
    const int tissue = model.tissue_of_label[label];
    if (tissue < 0) continue;
    alone.tissues[static_cast<std::size_t>(tissue)].touchable = true;
    const Body one = one_body(alone);
    body.surfaces.insert(body.surfaces.end(), one.surfaces.begin(), one.surfaces.end());
  }
  return body;
}

/// Oracle for penetration of more than half a voxel. A point is inside if all voxels within one voxel of it
/// are touchable; a sphere if it covers a touchable voxel centre by more than half the largest spacing.
class DeepPenetrationOracle {
 public:
  explicit DeepPenetrationOracle(const Body& body)
      : body_(body),
        labels_(*body.model->labels),
        X_VoxelPatient_(labels_.geometry().X_PatientVoxel().inverse()) {}

  bool inside(const Point<Patient>& proxy, double radius_mm) const {
    const Point<Voxel> p = X_VoxelPatient_ * proxy;
    const Eigen::Vector3d& spacing_mm = labels_.geometry().spacing_mm;
    const double over_mm = radius_mm - 0.5 * spacing_mm.maxCoeff();
    // a point: whether everything within a voxel of it is felt
    const bool point = radius_mm == 0;
    if (!point && over_mm <= 0) return false;
    const Eigen::Vector3d reach =
        point ? Eigen::Vector3d::Ones() : Eigen::Vector3d(over_mm * spacing_mm.cwiseInverse());
    for (int k = static_cast<int>(std::ceil(p.z() - reach.z())); k <= p.z() + reach.z(); ++k)
      for (int j = static_cast<int>(std::ceil(p.y() - reach.y())); j <= p.y() + reach.y(); ++j)
        for (int i = static_cast<int>(std::ceil(p.x() - reach.x())); i <= p.x() + reach.x(); ++i) {
          const bool touchable = body_.is_touchable(labels_.anywhere(i, j, k));
          if (point && !touchable) return false;
          const Eigen::Vector3d distance_mm = (Eigen::Vector3d(i, j, k) - p.eigen()).cwiseProduct(spacing_mm);
          if (!point && touchable && distance_mm.norm() < over_mm) return true;
        }
    return point;
  }

 private:
  const Body& body_;
  const Bricks<LabelId>& labels_;
  Transform<Voxel, Patient> X_VoxelPatient_;
};

struct Figures {
  int presses = 0, withdrawals = 0, elsewhere = 0, unfelt = 0, inside = 0, jumped = 0, drawn_after = 0,
      pulled_inward = 0, trapped = 0, left_out = 0;
  double largest_jump_N = 0, max_drawn_N = 0, max_inward_N = 0;
};

/// Presses a sphere on a body, slides it, and withdraws it along the direction of the force.
class SeamPress {
 public:
  SeamPress(const Body& body, const DeepPenetrationOracle& oracle, double radius_mm, Figures& figures)
      : body_(body), oracle_(oracle), tool_{{}, radius_mm}, figures_(figures) {}

  void run(const Point<Patient>& target, const Vector<Patient>& outward, double lateral) {
    const auto start = body_.free_place(target, outward, tool_.radius_mm, kFar_mm);
    if (!start) {
      ++figures_.left_out;
      return;
    }
    ++figures_.presses;
    tip_ = start_ = *start;
    advance();
    const auto lead = [&](const Vector<Patient>& step) {
      tip_ += step;
      advance();
    };
    while (force_N() < kPress_N && (tip_ - *start).norm() < kFar_mm + kDeepest_mm) lead(outward * -kStep_mm);
    const Eigen::Vector3d across = outward.eigen().unitOrthogonal();
    const Vector<Patient> along(Eigen::AngleAxisd(lateral, outward.eigen()) * across);
    for (double slid_mm = 0; slid_mm < kSlide_mm && force_N() < kSlideMost_N; slid_mm += kStep_mm)
      lead(along * kStep_mm);
    // a path that left the body on another side cannot be withdrawn
    if (!came_out_) withdraw();
    figures_.unfelt += unfelt_;
    figures_.inside += inside_;
    figures_.jumped += jumped_;
  }

 private:
  // withdraws along the force until the tip has been free for kWithdrawn_mm; ends early at a structure above
  // or at hard tissue on the path
  void withdraw() {
    const Vector<Patient> out = result_.force_N.normalized();
    outward_ = out;
    withdrawing_ = true;
    double free_mm = 0;
    std::array<bool, kMaxLayers> left{};
    for (double distance_mm = 0; distance_mm < kFar_mm + kDeepest_mm && free_mm < kWithdrawn_mm;
         distance_mm += kStep_mm) {
      const bool was_free = free_mm > 0;
      tip_ += out * kStep_mm;
      const bool free = is_free();
      if (was_free && !free) return;
      // a proxy at rest that holds the hand back, or free space that no straight way leads to from where it
      // came
      const bool held_back = !result_.lagging && result_.force_N.dot(out) < -kInward_N;
      if (!was_free && (held_back || (free && !is_where_it_came_from()))) {
        ++figures_.elsewhere;
        return;
      }
      for (int layer = 1; layer < kMaxLayers; ++layer) {
        bool& out_of_it = left[static_cast<std::size_t>(layer)];
        const double clearance_mm = body_.clearance_mm(tip_, tool_.radius_mm, layer);
        if (out_of_it && clearance_mm < -kOutside_mm) return;
        out_of_it = out_of_it || clearance_mm > kOutside_mm;
      }
      if (free) free_mm += kStep_mm;
      free_mm_ = free_mm;
      advance();
      // the tip was pulled through a structure that now lies between it and its proxy
      if (free_mm > kSlipOver_mm && inward_N() > kFree_N && is_beyond_a_wall()) {
        ++figures_.elsewhere;
        return;
      }
    }
    if (free_mm < kWithdrawn_mm) return;
    ++figures_.withdrawals;
    figures_.trapped += force_N() > kFree_N;
    figures_.drawn_after += max_drawn_N_ > kInward_N;
    figures_.pulled_inward += max_inward_N_ > kFree_N;
    figures_.max_drawn_N = std::max(figures_.max_drawn_N, max_drawn_N_);
    figures_.max_inward_N = std::max(figures_.max_inward_N, max_inward_N_);
  }

  // whether a tool that is led there straight from where this one began gets there
  bool is_where_it_came_from() const {
    ProxyState other;
    const Vector<Patient> displacement = tip_ - start_;
    const int steps = static_cast<int>(displacement.norm() / (5 * kStep_mm)) + 1;
    for (int n = 0; n <= steps; ++n)
      advance_proxy(body_.surfaces, {&tool_, 1}, start_ + displacement * (static_cast<double>(n) / steps),
                    other);
    return (other.position - tip_).norm() < kOutside_mm;
  }

  // whether the straight way from a proxy that pulls to the tip leads through what it rests on
  bool is_beyond_a_wall() const {
    for (int layer = 0; layer < kMaxLayers; ++layer) {
      if (!(result_.of_layer[static_cast<std::size_t>(layer)].force_N.dot(outward_) < 0)) continue;
      const Point<Patient>& from = state_.layer(layer).position;
      if (body_.clearance_mm(from, tool_.radius_mm, layer) < -kOutside_mm) return false;
      const Vector<Patient> displacement = tip_ - from;
      for (double part = 0; part < 1; part += kStep_mm / displacement.norm())
        if (body_.clearance_mm(from + displacement * part, tool_.radius_mm, layer) < -kOutside_mm)
          return true;
    }
    return false;
  }

  // clearance from all layers, including inner ones, which may reach the outside
  bool is_free() const {
    for (int layer = 0; layer < kMaxLayers; ++layer)
      if (body_.clearance_mm(tip_, tool_.radius_mm, layer) <= kOutside_mm) return false;
    return true;
  }

  double force_N() const { return result_.force_N.norm(); }
  double inward_N() const { return -result_.force_N.dot(outward_); }
  // layers may pull against each other
  double rendered_N() const {
    double all_N = 0;
    for (const ProxyForce& layer : result_.of_layer) all_N += layer.force_N.norm();
    return all_N;
  }

  void advance() {
    const Vector<Patient> before_N = result_.force_N;
    const double before_K = result_.stiffness_N_per_mm;
    result_ = advance_proxy(body_.surfaces, {&tool_, 1}, tip_, state_);
    const double non_slip_change_N = std::max(before_K, result_.stiffness_N_per_mm) * kStep_mm;
    const double jump_N = (result_.force_N - before_N).norm() - non_slip_change_N;
    figures_.largest_jump_N = std::max(figures_.largest_jump_N, jump_N);
    jumped_ = jumped_ || jump_N > kJump_N;
    inside_ = inside_ || oracle_.inside(state_.position, tool_.radius_mm);
    unfelt_ =
        unfelt_ || (rendered_N() < kContact_N && body_.clearance_mm(tip_, tool_.radius_mm) < -kContact_mm);
    for (int layer = 0; layer < kMaxLayers && !withdrawing_; ++layer)
      came_out_ = came_out_ || (state_.layer(layer).contact_count > 0 &&
                                body_.clearance_mm(tip_, tool_.radius_mm, layer) > kOutside_mm);
    if (free_mm_ == 0) return;
    double& max_N = free_mm_ > kSlipOver_mm ? max_inward_N_ : max_drawn_N_;
    max_N = std::max(max_N, inward_N());
  }

  const Body& body_;
  const DeepPenetrationOracle& oracle_;
  ToolPart tool_;
  Figures& figures_;
  ProxyState state_;
  ProxyResult result_;
  Point<Patient> tip_, start_;
  Vector<Patient> outward_;
  bool withdrawing_ = false, came_out_ = false, inside_ = false, unfelt_ = false, jumped_ = false;
  double free_mm_ = 0;
  double max_drawn_N_ = 0, max_inward_N_ = 0;  // until kSlipOver_mm, and from there
};

Figures press_all_over(const Body& body, int presses, double radius_mm) {
  std::mt19937 random(kSeamSeed);
  Figures figures;
  const DeepPenetrationOracle oracle(body);
  const ExposedVoxels voxels = exposed_voxels(body);
  const auto X_PatientVoxel = body.model->labels->geometry().X_PatientVoxel();
  std::uniform_real_distribution<double> turn(0, 6.283185307179586);
  for (int n = 0; n < presses; ++n) {
    const Point<Patient> target = X_PatientVoxel * voxels.any(n % 2 == 0, random);
    SeamPress(body, oracle, radius_mm, figures).run(target, body.outward(target), turn(random));
  }
  return figures;
}

void print(const char* what, double radius_mm, const Figures& f) {
  std::printf(
      "%-13s tool %.1f mm: %5d presses, %3d inside, %3d not felt, %4d with a jump (largest %6.3f N); %5d "
      "withdrawn, %2d drawn after (at most %.3f N), %2d pulled inward (%.3f N), %2d trapped; %3d elsewhere\n",
      what, radius_mm, f.presses, f.inside, f.unfelt, f.jumped, f.largest_jump_N, f.withdrawals,
      f.drawn_after, f.max_drawn_N, f.pulled_inward, f.max_inward_N, f.trapped, f.elsewhere);
  std::fflush(stdout);
}

void expect_no_seams(const char* what, const Model& model) {
  SCOPED_TRACE("seed " + std::to_string(kSeamSeed));
  const Body body = one_body(model);
  int withdrawals = 0, elsewhere = 0, drawn_after = 0, pulled_inward = 0;
  for (const double radius_mm : {0.0, 0.5, 1.5, 3.0}) {
    const Figures figures = press_all_over(body, seam_presses() / 4, radius_mm);
    withdrawals += figures.withdrawals;
    elsewhere += figures.elsewhere;
    drawn_after += figures.drawn_after;
    pulled_inward += figures.pulled_inward;
    print(what, radius_mm, figures);
    EXPECT_GT(figures.withdrawals, figures.presses / 4);
    EXPECT_EQ(figures.inside, 0);
    EXPECT_EQ(figures.jumped, 0);
    EXPECT_LT(figures.max_inward_N, 2 * kDrag_N);
    EXPECT_EQ(figures.trapped, 0);
  }
  EXPECT_LT(elsewhere, withdrawals / 6);
  // a few of ten thousand; which ones depends on the processor's rounding
  EXPECT_LE(drawn_after, 1 + withdrawals / 500);
  EXPECT_LE(pulled_inward, 1 + withdrawals / 5000);
  if (std::getenv("PALPATE_TEST_APART") != nullptr) {
    const Body before = with_separate_label_surfaces(model);
    for (const double radius_mm : {0.0, 0.5, 1.5, 3.0})
      print("labels apart", radius_mm, press_all_over(before, seam_presses() / 4, radius_mm));
  }
}

/// A block with a flat top, halved by a plane across it that is turned from the grid.
LabelMap flat_top(const Eigen::Vector3d& spacing_mm, double turned_degrees) {
  GridGeometry grid;
  constexpr double kWide_mm = 26, kHigh_mm = 12;
  for (int a = 0; a < 3; ++a)
    grid.dims[static_cast<std::size_t>(a)] =
        static_cast<int>((a < 2 ? kWide_mm : 1.6 * kHigh_mm) / spacing_mm[a]);
  grid.spacing_mm = spacing_mm;
  LabelMap map;
  map.layers.emplace_back(grid);
  const double turned = turned_degrees * 0.017453292519943295;
  for (int k = 0; k < grid.dims[2] && (k + 0.5) * spacing_mm.z() < kHigh_mm; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const double x = i * spacing_mm.x() - 0.5 * kWide_mm, y = j * spacing_mm.y() - 0.5 * kWide_mm;
        map.layers[0].at(i, j, k) = x * std::cos(turned) + y * std::sin(turned) < 0 ? 1 : 2;
      }
  map.segments = {{1, "one", {}, 0, 1}, {2, "other", {}, 0, 2}};
  return map;
}

struct Crossing {
  double dip_mm = 0, drag_N = 0, jump_N = 0;
  // straight across: the place beside the seam, mm, and the force, N
  std::vector<std::array<double, 2>> up_N, tangential_force_N;
};

// 1 mm deep across the seam and along it, 1 N/mm
Crossing cross(const Body& body, double radius_mm) {
  const GridGeometry& grid = body.model->labels->geometry();
  const Point<Patient> centre =
      grid.X_PatientVoxel() * Point<Voxel>(0.5 * grid.dims[0], 0.5 * grid.dims[1], 0);
  const double from_mm = 4;
  double top_mm = 0;
  for (double z = 0; z < 24; z += 0.01)
    if (body.clearance_mm(Point<Patient>(centre.x() - from_mm, centre.y(), z), 0) < 0) top_mm = z;
  const ToolPart tool{{}, radius_mm};
  Crossing found;
  double lowest_mm = std::numeric_limits<double>::infinity(), highest_mm = -lowest_mm;
  for (const double heading : {0.0, 0.7, 1.4}) {
    const Eigen::Vector3d along(std::cos(heading), std::sin(heading), 0);
    ProxyState state;
    ProxyResult before;
    for (double distance_mm = -from_mm - 3; distance_mm < from_mm; distance_mm += kStep_mm) {
      // it comes down in front of the seam
      const double deep_mm = std::min(1.0, distance_mm + from_mm + 2);
      const Point<Patient> tip(centre.x() + along.x() * distance_mm, centre.y() + along.y() * distance_mm,
                               top_mm + radius_mm - deep_mm);
      const ProxyResult result = advance_proxy(body.surfaces, {&tool, 1}, tip, state);
      if (distance_mm > -from_mm) {
        lowest_mm = std::min(lowest_mm, state.position.z());
        highest_mm = std::max(highest_mm, state.position.z());
        found.drag_N = std::max(found.drag_N, std::hypot(result.force_N.x(), result.force_N.y()));
        found.jump_N = std::max(found.jump_N, (result.force_N - before.force_N).norm() - kStep_mm);
        if (heading == 0) {
          found.up_N.push_back({distance_mm, result.force_N.z()});
          found.tangential_force_N.push_back(
              {distance_mm, std::hypot(result.force_N.x(), result.force_N.y())});
        }
      }
      before = result;
    }
  }
  found.dip_mm = highest_mm - lowest_mm;
  return found;
}

// the force of a point that is led across a seam, and what drags it aside
void draw(const Crossing& before, const Crossing& after, const std::filesystem::path& folder) {
  const auto chart = [&](const char* title, const char* up, const auto& was, const auto& is,
                         const char* file) {
    test::Chart picture(title, "mm from the seam", up, -4, 4, 4);
    for (const double mm : {-4, -2, 0, 2, 4}) picture.tick_across(mm);
    for (const double N : {0, 1, 2, 3, 4}) picture.tick_up(N);
    picture.line("before", "labels apart", was);
    picture.line("after", "one body", is);
    picture.write(folder / file);
  };
  const char* press =
      "N upward on a point 1 mm below the flat top of two labels, 1 N/mm; voxels of 0.28 \u00d7 0.28 \u00d7 "
      "1.0 mm";
  const char* drag = "N aside on the same point, without friction";
  chart("Force across a seam", press, before.up_N, after.up_N, "seam-force.svg");
  chart("Drag at a seam", drag, before.tangential_force_N, after.tangential_force_N, "seam-drag.svg");
}

// With PALPATE_DRAW_SEAMS=FOLDER two pictures there: docs/images has them.
TEST(Seams, FlatSeamsAreNotRendered) {
  const char* folder = std::getenv("PALPATE_DRAW_SEAMS");
  for (const Eigen::Vector3d& spacing_mm :
       {Eigen::Vector3d(0.36, 0.36, 0.7), Eigen::Vector3d(0.625, 0.625, 0.9),
        Eigen::Vector3d(0.28, 0.28, 1)}) {
    for (const double turned : {0.0, 25.0, 60.0}) {
      const Model model = model_of(flat_top(spacing_mm, turned), [](const Segment&) { return 1.0; });
      const Body body = one_body(model), before = with_separate_label_surfaces(model);
      for (const double radius_mm : {0.0, 0.5, 1.5, 3.0}) {
        const Crossing one = cross(body, radius_mm), two = cross(before, radius_mm);
        if (folder != nullptr && radius_mm == 0 && turned == 0) draw(two, one, folder);
        std::printf(
            "%.2f mm, %2.0f degrees, tool %.1f mm: dip %.3f mm, drag %.3f N, jump %.3f N; labels apart %.3f, "
            "%.3f, %.3f\n",
            spacing_mm.x(), turned, radius_mm, one.dip_mm, one.drag_N, one.jump_N, two.dip_mm, two.drag_N,
            two.jump_N);
        EXPECT_LT(one.drag_N, kDrag_N);
        EXPECT_LT(one.jump_N, kJump_N);
        // the top of a single label, too, bends by this towards the edges of the block
        EXPECT_LT(one.dip_mm, 0.1);
        // positive control: with separate labels the seam is measurable
        if (radius_mm == 0) {
          EXPECT_GT(two.dip_mm, 0.3);
          EXPECT_GT(two.drag_N, 0.5);
        }
      }
    }
  }
}

void expect_no_seams_in(const char* what, const std::string& name, double min_N_per_mm) {
  PALPATE_SHARED_FILE(file, name);
  const auto labels = labels_of(file);
  ASSERT_TRUE(labels);
  expect_no_seams(what, model_of(*labels, [&](const Segment& segment) {
                    const auto stiffness = as_proposed(segment);
                    return stiffness && *stiffness >= min_N_per_mm ? stiffness : std::nullopt;
                  }));
}

// all of its 48 structures where many presses are asked for: preparing them takes longer than pressing them
TEST(Seams, HandSegmentedKneeHasNoSeams) {
  const bool whole = seam_presses() >= 1000;
  expect_no_seams_in("knee_spl", "knee_spl/seg.nrrd", whole ? 0 : 0.2);
}

TEST(Seams, ObliqueKneeHasNoSeams) {
  expect_no_seams_in("knee_dess", "knee_dess/SAG_3D_DESS_RIGHT_bones_cart_men_fib-label.nrrd", 0);
}

// 116 brain regions, each adjacent to many others: with one stiffness, and with four
TEST(Seams, HeadHasNoSeams) {
  const std::filesystem::path file = "/usr/share/mricron/templates/aal.nii.gz";
  if (!std::filesystem::exists(file)) {
    if (in_ci()) FAIL() << "the package mricron-data is not installed";
    GTEST_SKIP() << "needs the package mricron-data";
  }
  const auto labels = labels_of(file);
  ASSERT_TRUE(labels);
  expect_no_seams("head", model_of(*labels, [](const Segment&) { return 0.4; }));
  if (seam_presses() < 1000) return;
  expect_no_seams("head, layers",
                  model_of(*labels, [](const Segment& segment) { return 0.2 + 0.3 * (segment.id % 4); }));
}

TEST(Seams, PhantomKneeHasNoSeams) {
  const auto parameters = parse_phantom("knee-phantom:spacing=0.8");
  ASSERT_TRUE(parameters.ok());
  const auto phantom = make_phantom(*parameters);
  ASSERT_TRUE(phantom.ok());
  expect_no_seams("knee-phantom", model_of(phantom->labels, as_proposed));
}

}  // namespace
}  // namespace palpate
