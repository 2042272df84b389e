// Two simulated adversaries against the redaction, over fifty random variants of each shipped quiz. Each
// receives what a learner receives and knows more than any learner: the variant's anatomy without the hidden
// structure. One never touches; the other touches by script. The phantoms are those of the tasks, with
// coarser voxels.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <set>

#include "base/test_folder.h"
#include "base/test_seed.h"
#include "palpate/phantoms/phantoms.h"
#include "palpate/scene/task_file.h"
#include "server/distance_message.h"
#include "server/pose_message.h"
#include "server/redacted_region.h"
#include "server/redaction.h"
#include "server/scene_json.h"
#include "server/test_client.h"
#include "server/test_host.h"

namespace palpate::server {
namespace {

using palpate::test::TemporaryFolder;
using palpate::test::write_private;
using palpate::testing::FakeHost;
using palpate::testing::Json;
using palpate::testing::number_at;
using palpate::testing::request;
using palpate::testing::TestAnswer;

constexpr std::uint64_t kDraws = 50;
constexpr const char* kSpacing = ",spacing=1.6";
constexpr double kSignificant = 0.001;
constexpr const char* kCampaignToken = "learner-token-k7wq2mzr9xbt4";

std::vector<std::string> shipped_quizzes() {
  std::vector<std::string> names;
  for (const EmbeddedFile& file : embedded_tasks()) {
    const std::string name(file.name.substr(0, file.name.find('.')));
    if (load_task(name)->quiz) names.push_back(name);
  }
  return names;
}

LabelId label_of(const std::vector<ViewedStructure>& structures, const std::string& name) {
  const auto found = std::ranges::find(structures, name, &ViewedStructure::name);
  return found == structures.end() ? LabelId{0} : found->label;
}

Eigen::Vector3d index_of(const GridGeometry& grid, std::size_t voxel) {
  const auto nx = static_cast<std::size_t>(grid.dims[0]), ny = static_cast<std::size_t>(grid.dims[1]);
  return (grid.X_PatientVoxel() * Point<Voxel>(static_cast<double>(voxel % nx),
                                               static_cast<double>(voxel / nx % ny),
                                               static_cast<double>(voxel / nx / ny)))
      .eigen();
}

template <class IsWanted>
std::optional<Eigen::Vector3d> middle_of(const Volume<LabelId>& labels, const IsWanted& is_requested) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double count = 0;
  for (std::size_t v = 0; v < labels.voxels().size(); ++v) {
    if (!is_requested(v)) continue;
    sum += index_of(labels.geometry(), v);
    ++count;
  }
  return count > 0 ? std::optional<Eigen::Vector3d>(sum / count) : std::nullopt;
}

/// Task of a file as a session offers it, as far as it is published.
ViewedTask task_in(const TaskFile& file, const std::string& name, const ViewedScene& scene) {
  ViewedTask task;
  task.name = name;
  task.title = file.title;
  task.quiz = file.quiz;
  const auto labels_of = [&](const std::vector<LabelReference>& structures) {
    std::vector<LabelId> labels;
    for (const LabelReference& structure : structures)
      labels.push_back(label_of(scene.structures, std::get<std::string>(structure)));
    return labels;
  };
  for (const TaskRegion& region : file.regions) {
    ViewedTask::Region::Extent extent;
    extent.labels = labels_of(region.structures);
    if (region.plane_point) {
      const Eigen::Vector3d point = region.plane_point->eigen(), normal = region.plane_normal->eigen();
      extent.planes.push_back({{point.x(), point.y(), point.z()}, {normal.x(), normal.y(), normal.z()}});
    }
    task.regions.push_back(region_in(scene, {region.name, {}, 0, {}, extent}));
  }
  for (const TaskForce& force : file.forces)
    task.forces.push_back({labels_of(force.structures), force.band_N, force.limit_N});
  task.to_find = labels_of(file.answer->structures);
  return task;
}

/// One variant of a quiz: the original scene, and the same anatomy without the hidden structure.
struct Draw {
  Draw(const std::string& name, std::uint64_t seed) {
    const TaskFile file = *load_task(name);
    const auto parameters = *parse_phantom(drawn_data_set(file, seed) + kSpacing);
    Phantom phantom = *make_phantom(parameters);
    whole = phantom.labels.flattened();
    ViewedScene& scene = host.edit_scene();
    scene.structures.clear();
    scene.tissues.clear();
    scene.tools = {{"probe", 1, false, "", {{0, 0, 0}}, {}}};
    for (const Segment& segment : phantom.labels.segments) {
      scene.structures.push_back(
          {segment.id, segment.name, segment.colour, static_cast<int>(scene.tissues.size())});
      scene.tissues.push_back({segment.name, true, segment.colour, 1, {}});
    }
    scene.scan = std::make_shared<const Volume<float>>(std::move(phantom.scan));
    scene.labels = label_bricks(whole);
    scene.content_hash = scene.labels->content_hash();
    scene.distance_reach_mm = 20;
    scene.no_go = {{"away", 1, scene.structures.front().label}};
    scene.tasks = {task_in(file, name, scene)};
    hidden = scene.tasks[0].to_find.front();

    // a lesion replaces voxels of its structure, a nodule voxels of soft tissue
    const auto* knee = std::get_if<KneeParameters>(&parameters);
    around = label_of(scene.structures, knee != nullptr ? knee->lesion_in : "soft_tissue");
    bare = whole;
    std::ranges::replace(bare.voxels(), hidden, around);
    for (const ViewedTask::Force& force : scene.tasks[0].forces)
      for (const LabelId label : force.labels)
        if (label != hidden) candidates.insert(label);
    centre = *middle_of(whole, [&](std::size_t v) { return whole.voxels()[v] == hidden; });
    blind = *middle_of(bare, [&](std::size_t v) { return candidates.contains(bare.voxels()[v]); });

    ViewedScene& without = bare_host.edit_scene();
    without = scene;
    without.labels = label_bricks(bare);
    without.content_hash = without.labels->content_hash();
    for (ViewedTask::Region& region : without.tasks[0].regions) region = region_in(without, region);
  }
  double error_mm(const Eigen::Vector3d& guess) const { return (guess - centre).norm(); }

  FakeHost host, bare_host;
  Volume<LabelId> whole, bare;
  LabelId hidden = 0, around = 0;
  std::set<LabelId> candidates;  ///< Structures that may contain the hidden one
  Eigen::Vector3d centre, blind;
};

/// Probability that at least `better` of better + worse fair coins fall on one given side (one-sided sign
/// test).
double sign_test(int better, int worse) {
  const int all = better + worse;
  double p = 0;
  for (int n = better; n <= all; ++n)
    p += std::exp(std::lgamma(all + 1) - std::lgamma(n + 1) - std::lgamma(all - n + 1) - all * std::log(2));
  return p;
}

/// Errors of an adversary compared with those of one that receives less, over all variants.
struct Duel {
  int better = 0, worse = 0, draws = 0;
  double own_mm = 0, other_mm = 0, farthest_apart_mm = 0;

  void add(double own, double other) {
    ++draws;
    better += own < other - 1e-9;
    worse += own > other + 1e-9;
    own_mm += own;
    other_mm += other;
    farthest_apart_mm = std::max(farthest_apart_mm, std::abs(own - other));
  }
  void print(const std::string& what) const {
    std::printf("%s: error %.1f mm against %.1f mm, better in %d, worse in %d of %d draws, p %.2g\n",
                what.c_str(), own_mm / draws, other_mm / draws, better, worse, draws,
                sign_test(better, worse));
  }
};

// ---- the adversary that never touches

/// Its data: voxels, and the page's view of each region.
struct Shown {
  Volume<LabelId> labels;
  std::vector<Eigen::Vector3d> middles;
};

std::vector<Eigen::Vector3d> middles_of(const ViewedTask& task) {
  std::vector<Eigen::Vector3d> middles;
  for (const ViewedTask::Region& region : task.regions)
    middles.emplace_back(region.centre_mm[0], region.centre_mm[1], region.centre_mm[2]);
  return middles;
}

/// Knows the anatomy: voxels that differ from it were hidden. Without any, the missing part of a region lies
/// opposite to the displacement of the region's centre.
Eigen::Vector3d guess_unfelt(const Draw& draw, const Shown& shown) {
  const auto odd =
      middle_of(draw.bare, [&](std::size_t v) { return shown.labels.voxels()[v] != draw.bare.voxels()[v]; });
  if (odd) return *odd;
  const auto expected = middles_of(draw.bare_host.scene().tasks[0]);
  std::size_t largest = 0;
  for (std::size_t n = 0; n < expected.size(); ++n)
    if ((shown.middles[n] - expected[n]).norm() > (shown.middles[largest] - expected[largest]).norm())
      largest = n;
  const Eigen::Vector3d moved = shown.middles[largest] - expected[largest];
  constexpr double kRounding_mm = 1e-9;
  if (moved.norm() < kRounding_mm) return draw.blind;
  return expected[largest] -
         0.5 * draw.bare_host.scene().tasks[0].regions[largest].radius_mm * moved.normalized();
}

/// Insecure baseline: the hidden structure becomes the one with the largest shared surface, air included.
Volume<LabelId> shown_by_most_faces(const Draw& draw) {
  std::map<LabelId, std::size_t> faces;
  const Bricks<LabelId>& labels = *draw.host.scene().labels;
  const auto& dims = draw.whole.geometry().dims;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i) {
        if (draw.whole.at(i, j, k) != draw.hidden) continue;
        for (int axis = 0; axis < 3; ++axis)
          for (const int side : {-1, 1}) {
            const LabelId other =
                labels.anywhere(i + side * (axis == 0), j + side * (axis == 1), k + side * (axis == 2));
            if (other != draw.hidden) ++faces[other];
          }
      }
  const auto most = std::ranges::max_element(faces, {}, [](const auto& entry) { return entry.second; });
  Volume<LabelId> shown = draw.whole;
  std::ranges::replace(shown.voxels(), draw.hidden, most->first);
  return shown;
}

// ---- the adversary that touches

/// Data of one touch.
struct Touched {
  Eigen::Vector3d tip_mm;
  double force_N = 0;
  bool is_odd = false;  ///< Whether a value in the message is inconsistent with the visible structures
};

/// Random places on the structures that may contain the hidden one.
std::vector<Eigen::Vector3d> script_of(const Draw& draw, std::mt19937_64& random) {
  constexpr std::size_t kTouches = 240;
  std::vector<std::size_t> skin;
  const Bricks<LabelId>& labels = *draw.bare_host.scene().labels;
  const auto& dims = draw.bare.geometry().dims;
  std::size_t v = 0;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i, ++v) {
        if (!draw.candidates.contains(draw.bare.voxels()[v])) continue;
        bool is_open = false;
        for (int axis = 0; axis < 3; ++axis)
          for (const int side : {-1, 1})
            is_open |=
                labels.anywhere(i + side * (axis == 0), j + side * (axis == 1), k + side * (axis == 2)) == 0;
        if (is_open) skin.push_back(v);
      }
  std::ranges::shuffle(skin, random);
  skin.resize(std::min(skin.size(), kTouches));
  std::vector<Eigen::Vector3d> positions;
  for (const std::size_t voxel : skin) positions.push_back(index_of(draw.bare.geometry(), voxel));
  return positions;
}

/// Tick in which the tip is pressed in at a place. The hidden structure is softer and affects the nearest
/// places of the surface; tremor adds noise to single forces. All other values are as a servo records them.
TickRecord pressed(const Draw& draw, const Eigen::Vector3d& position, double min_mm,
                   std::mt19937_64& random) {
  constexpr double kContactWithin_mm = 6, kTremor = 0.5;
  std::normal_distribution<double> tremor(0, kTremor);
  const double distance_mm = (position - draw.centre).norm();
  const double fraction = std::clamp(1 - (distance_mm - min_mm) / kContactWithin_mm, 0.0, 1.0);
  TickRecord tick;
  DeviceTick& device = tick.device[0];
  device.tip_patient_mm = {position.x(), position.y(), position.z()};
  device.force_N = {0, 0, (1 - 0.7 * fraction) * std::exp(tremor(random))};
  device.unclamped_force_N = device.force_N[2];
  device.limit_N = 5;
  device.flags = kFlagContact;
  device.depth_mm = 1;
  const bool is_over = fraction > 0;
  device.label = is_over ? draw.hidden : draw.around;
  device.contact_label = {draw.around, is_over ? draw.hidden : LabelId{0}};
  device.contact_N = {(1 - fraction) * device.force_N[2], fraction * device.force_N[2]};
  device.path_label = {draw.around, is_over ? draw.hidden : LabelId{0}};
  device.path_share = {1 - fraction, fraction};
  device.near_label = {draw.around, draw.hidden};
  device.near_mm = {is_over ? 0.5 : 0, distance_mm};
  device.no_go = is_over;
  device.no_go_depth_mm = fraction;
  return tick;
}

constexpr std::size_t kFirstDevice = PoseMessage::kHead_bytes;

/// Parses messages byte by byte, by the layout of docs/reference/viewer-messages.md.
Touched read(const std::string_view pose, const std::string_view near) {
  Touched touched;
  for (int axis = 0; axis < 3; ++axis)
    touched.tip_mm[axis] = number_at<float>(pose, kFirstDevice + 4 * static_cast<std::size_t>(axis));
  touched.force_N = number_at<float>(pose, kFirstDevice + 60);
  // a second structure that contributes force or supports the tool, or a near structure that is not at the
  // tip
  const bool is_shared = number_at<std::uint16_t>(pose, kFirstDevice + 104 + 12) != 0 ||
                         number_at<std::uint16_t>(pose, kFirstDevice + 176 + 20) != 0;
  const bool is_apart =
      number_at<std::uint16_t>(near, 24 + 12) != 0 && number_at<float>(near, 24 + 16) > 0.1f;
  const bool is_kept_away = number_at<std::uint16_t>(near, 24) != 0;
  touched.is_odd = is_shared || is_apart || is_kept_away;
  return touched;
}

/// Uses inconsistent messages if there are any, else the region of low forces.
Eigen::Vector3d guess_touchable(const std::vector<Touched>& touches) {
  Eigen::Vector3d odd = Eigen::Vector3d::Zero(), best = Eigen::Vector3d::Zero();
  int odd_count = 0;
  double largest = -1e9;
  for (const Touched& touch : touches) {
    if (touch.is_odd) {
      odd += touch.tip_mm;
      ++odd_count;
    }
    constexpr double kWithin_mm = 5;
    double sum = 0;
    int count = 0;
    for (const Touched& other : touches)
      if ((other.tip_mm - touch.tip_mm).norm() < kWithin_mm) {
        sum -= std::log(other.force_N);
        ++count;
      }
    // in standard errors, so that a place with few touches does not win by chance
    const double score = sum / std::sqrt(count);
    if (score <= largest) continue;
    largest = score;
    best = touch.tip_mm;
  }
  return odd_count > 0 ? Eigen::Vector3d(odd / odd_count) : best;
}

/// Fields that an insecure baseline would leave in the tick.
enum class Leak { kNone, kForces, kDistances };

TickRecord reported(const Redaction& redaction, const TickRecord& tick, Leak leak) {
  TickRecord record = redaction.of(tick);
  const DeviceTick& from = tick.device[0];
  DeviceTick& to = record.device[0];
  if (leak == Leak::kForces) {
    to.contact_label = from.contact_label;
    to.contact_N = from.contact_N;
    to.path_label = from.path_label;
    to.path_share = from.path_share;
  }
  if (leak == Leak::kDistances) {
    to.near_label = {from.near_label[0]};
    to.near_mm = {from.near_mm[0]};
    to.no_go = from.no_go;
    to.no_go_depth_mm = from.no_go_depth_mm;
  }
  return record;
}

std::string bytes_of(const TickRecord& record) {
  return std::string(PoseMessage(record, {}, {}, 0).bytes()) + std::string(DistanceMessage(record).bytes());
}

// ---- routes

/// Everything that a server sends to a learner about a scene by HTTP.
std::vector<std::string> answers_of_campaign(FakeHost& host) {
  const TemporaryFolder folder;
  ViewerServerOptions options;
  options.port = 0;
  options.token_file = write_private(folder / "tokens", std::string("learner ") + kCampaignToken + " L042\n");
  const auto server = *ViewerServer::start(host, options);
  std::vector<std::string> answers;
  const auto ask = [&](const std::string& path, const std::string& fields = "") {
    const TestAnswer answer =
        request(server->port(), "GET", path,
                std::string("Authorization: Bearer ") + kCampaignToken + "\r\n" + fields);
    std::string head = answer.head;
    const std::string port = ":" + std::to_string(server->port());
    if (const std::size_t at = head.find(port); at != std::string::npos) head.erase(at, port.size());
    answers.push_back(head + answer.body);
    return answer;
  };
  const Json scene = Json::parse(ask("/api/scene").body);
  const std::string hash = scene["volume"]["hash"];
  for (const std::string query : {"", "?shrink=2", "?shrink=4"})
    for (const std::string fields : {"", "Accept-Encoding: gzip\r\n"})
      ask("/api/volume/labels/" + hash + query, fields);
  ask("/api/volume/scan/" + hash + "?shrink=4");
  const GridGeometry& grid = host.scene().labels->geometry();
  const Eigen::Vector3d centre = grid.centre().eigen();
  const auto number = [](double value) { return std::to_string(value); };
  ask("/api/picture/" + hash + "?view=64,64," + number(centre.x() - 60) + "," + number(centre.y() - 200) +
      "," + number(centre.z() + 60) + ",1.875,0,0,0,0,-1.875");
  return answers;
}

// ---- comparison

/// Adversaries with more data against those with less, over all variants of a quiz.
struct Outcome {
  Duel untouched, by_faces, by_middles;   ///< Against a blind guess
  Duel touched, by_forces, by_distances;  ///< Against a program that only has pose and total force
};

void look(const Draw& draw, const Redaction& redaction, Outcome& outcome) {
  const double blind_mm = draw.error_mm(draw.blind);
  const Volume<LabelId> labels = redaction.scene().labels->dense();
  const auto middles = middles_of(redaction.scene().tasks[0]);
  const auto error_mm = [&](const Shown& shown) { return draw.error_mm(guess_unfelt(draw, shown)); };
  outcome.untouched.add(error_mm({labels, middles}), blind_mm);
  outcome.by_faces.add(error_mm({shown_by_most_faces(draw), middles}), blind_mm);
  outcome.by_middles.add(error_mm({labels, middles_of(draw.host.scene().tasks[0])}), blind_mm);
}

void touch(const Draw& draw, const Redaction& redaction, const Redaction& bare_redaction,
           std::mt19937_64& random, Outcome& outcome) {
  std::map<Leak, std::vector<Touched>> reported_by;
  std::vector<Touched> by_force;
  const std::vector<Eigen::Vector3d> positions = script_of(draw, random);
  double min_mm = 1e9;
  for (const Eigen::Vector3d& position : positions)
    min_mm = std::min(min_mm, (position - draw.centre).norm());
  for (const Eigen::Vector3d& at_position : positions) {
    const TickRecord tick = pressed(draw, at_position, min_mm, random);
    by_force.push_back(
        {at_position.cast<float>().cast<double>(), static_cast<float>(tick.device[0].force_N[2]), false});
    for (const Leak leak : {Leak::kNone, Leak::kForces, Leak::kDistances}) {
      const TickRecord record = reported(redaction, tick, leak);
      reported_by[leak].push_back(
          read(PoseMessage(record, {}, {}, 0).bytes(), DistanceMessage(record).bytes()));
    }
    // the same pose and force in the anatomy without the hidden structure give identical bytes
    TickRecord bare;
    bare.device[0].tip_patient_mm = tick.device[0].tip_patient_mm;
    bare.device[0].force_N = tick.device[0].force_N;
    bare.device[0].limit_N = tick.device[0].limit_N;
    ASSERT_TRUE(bytes_of(redaction.of(tick)) == bytes_of(bare_redaction.of(bare)));
  }
  const double by_force_mm = draw.error_mm(guess_touchable(by_force));
  const auto error_mm = [&](Leak leak) { return draw.error_mm(guess_touchable(reported_by[leak])); };
  outcome.touched.add(error_mm(Leak::kNone), by_force_mm);
  outcome.by_forces.add(error_mm(Leak::kForces), by_force_mm);
  outcome.by_distances.add(error_mm(Leak::kDistances), by_force_mm);
}

/// Checks that everything served for a variant equals what is served for the anatomy without the hidden
/// structure.
void compare(Draw& draw, const Redaction& redaction, const Redaction& bare_redaction, bool by_every_route) {
  ASSERT_TRUE(redaction.scene().labels->dense().voxels() == draw.bare.voxels());
  ASSERT_EQ(redaction.scene().content_hash, bare_redaction.scene().content_hash);
  const VolumeFacts facts{"", 1, 0, {0, 1}, false};
  const AuthenticatedViewer learner{Role::kLearner, "L042"};
  ASSERT_EQ(
      scene_json(redaction.scene(), redaction.of(draw.host.state()), facts, learner, true),
      scene_json(bare_redaction.scene(), bare_redaction.of(draw.bare_host.state()), facts, learner, true));
  if (!by_every_route) return;
  const auto answers = answers_of_campaign(draw.host), bare_answers = answers_of_campaign(draw.bare_host);
  ASSERT_TRUE(answers == bare_answers) << "a head or body of an answer differs";
}

Outcome played(const std::string& quiz) {
  const unsigned seed_of_hand = test::test_seed();
  Outcome outcome;
  for (std::uint64_t seed = 1; seed <= kDraws; ++seed) {
    SCOPED_TRACE(quiz + ", draw " + std::to_string(seed) + ", seed " + std::to_string(seed_of_hand));
    Draw draw(quiz, seed);
    const Redaction redaction(draw.host.scene()), bare_redaction(draw.bare_host.scene());
    std::mt19937_64 random(seed_of_hand + seed);
    compare(draw, redaction, bare_redaction, seed % 10 == 1);
    look(draw, redaction, outcome);
    touch(draw, redaction, bare_redaction, random, outcome);
    if (::testing::Test::HasFatalFailure()) break;
  }
  return outcome;
}

class RedactionCampaign : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(ShippedQuizzes, RedactionCampaign, ::testing::ValuesIn(shipped_quizzes()));

TEST_P(RedactionCampaign, RedactedDataLeakNoMoreThanPoseAndTotalForce) {
  const Outcome outcome = played(GetParam());
  outcome.untouched.print("never touches, against a blind guess");
  outcome.touched.print("touches, against pose and total force");
  // not only no better: identical guesses in every variant
  EXPECT_EQ(outcome.untouched.farthest_apart_mm, 0);
  EXPECT_EQ(outcome.touched.farthest_apart_mm, 0);

  // positive control: the same adversaries find each leak of the insecure baselines
  outcome.by_faces.print("  shown as what shares most faces, air counted");
  outcome.by_middles.print("  middles of regions of the labels as they are");
  outcome.by_forces.print("  forces and shares of structures");
  outcome.by_distances.print("  distances and depths");
  const auto is_found = [](const Duel& duel) { return sign_test(duel.better, duel.worse) < kSignificant; };
  EXPECT_TRUE(is_found(outcome.by_middles));
  EXPECT_TRUE(is_found(outcome.by_forces));
  EXPECT_TRUE(is_found(outcome.by_distances));
  // a nodule deep in soft tissue has no contact with air
  EXPECT_EQ(is_found(outcome.by_faces), GetParam() != "find-the-nodule");
}

// the reference anatomy equals what the generator makes without the hidden structure
TEST_P(RedactionCampaign, TheAnatomyWithoutItIsTheGenerators) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const Draw draw(GetParam(), seed);
    auto parameters = *parse_phantom(drawn_data_set(*load_task(GetParam()), seed) + kSpacing);
    if (auto* knee = std::get_if<KneeParameters>(&parameters)) {
      *knee = KneeParameters{.settings = knee->settings};
    } else {
      std::get<BlockParameters>(parameters).nodules.nodules = 0;
    }
    const Phantom bare = *make_phantom(parameters);
    EXPECT_TRUE(bare.labels.flattened().voxels() == draw.bare.voxels()) << seed;
    EXPECT_TRUE(bare.scan.voxels() == draw.host.scene().scan->voxels()) << seed;
  }
}

}  // namespace
}  // namespace palpate::server
