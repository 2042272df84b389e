#include "report/test_example_run.h"

#include <algorithm>
#include <cmath>

namespace palpate::report::example {
namespace {

struct Capsule {
  LabelId label;
  Point<Patient> a, b;
  double radius_mm;

  double distance_mm(const Point<Patient>& p) const {
    const Vector<Patient> axis = b - a;
    const double squared = axis.squared_norm();
    const double t = squared > 0 ? std::clamp((p - a).dot(axis) / squared, 0.0, 1.0) : 0.0;
    return (p - (a + axis * t)).norm() - radius_mm;
  }
};

// +x is the patient's left, where the fibula of a left knee is; the patella is anterior, at -y
const std::vector<Capsule>& capsules() {
  static const std::vector<Capsule> shapes{
      {kFemur, {-10, 0, 12}, {-10, 0, 12}, 15},  {kFemur, {11, 0, 12}, {11, 0, 12}, 14},
      {kFemur, {0, 0, 22}, {0, -2, 60}, 12},     {kTibia, {-9, 1, -17}, {9, 1, -17}, 10},
      {kTibia, {0, 1, -24}, {0, 2, -60}, 10},    {kFibula, {24, 7, -26}, {22, 8, -60}, 5},
      {kPatella, {0, -27, 12}, {0, -27, 15}, 8},
  };
  return shapes;
}

struct Nearest {
  LabelId label = 0;
  double distance_mm = 1e9;
};

/// Nearest structure; the cartilage is a layer of 2 mm on the lower side of the femur.
Nearest nearest(const Point<Patient>& p) {
  Nearest result;
  for (const Capsule& shape : capsules()) {
    const double distance = shape.distance_mm(p);
    if (distance < result.distance_mm) result = {shape.label, distance};
  }
  if (result.label == kFemur && p.z() < 14) result = {kFemoralCartilage, result.distance_mm - 2};
  if (result.label == kFemoralCartilage && result.distance_mm <= -2)
    result = {kFemur, result.distance_mm + 2};
  return result;
}

/// Deterministic noise in -1 ... 1.
double noise(std::uint32_t& state) {
  state = state * 1664525u + 1013904223u;
  return (state >> 8) / 8388608.0 - 1;
}

double intensity(const Point<Patient>& p, const Nearest& site) {
  const double from_axis = std::hypot(p.x() / 48, (p.y() + 2) / 42);
  if (from_axis > 1) return 12;
  if (site.distance_mm > 0) return from_axis > 0.9 ? 560 : 330 + 40 * std::sin(0.25 * p.x() + 0.2 * p.z());
  if (site.label == kFemoralCartilage) return 470;
  return site.distance_mm > -1.5 ? 60 : 620;  // MR contrast: cortical bone is dark, marrow is bright
}

/// One visit: straight approach along `from`, press to `depth_mm`, stroke, straight withdrawal.
struct Visit {
  Point<Patient> surface;
  Vector<Patient> outward;
  Vector<Patient> stroke;  ///< Displacement of the stroke, mm
  double depth_mm;
};

const std::vector<Visit>& visits() {
  static const std::vector<Visit> all{
      {{0, 0, 0}, Vector<Patient>(0, -1, 0), {4, 0, 0}, 0.55},
      {{-10, 0, 12}, Vector<Patient>(-0.3, -1, -0.8).normalized(), {0, 2, -2}, 0.6},
      {{0, -27, 13}, Vector<Patient>(0, -1, 0.1).normalized(), {1, 0, 3}, 0.9},
      {{23.5, 7, -34}, Vector<Patient>(1, -0.4, 0).normalized(), {0, 0, -5}, 0.5},
  };
  return all;
}

/// Exit point of a ray from `visit.surface`, by bisection between 0 and 40 mm.
Point<Patient> find_surface(const Visit& visit, const Point<Patient>& start) {
  double inside = 0, outside = 40;
  for (int i = 0; i < 30; ++i) {
    const double midpoint = 0.5 * (inside + outside);
    (nearest(start + visit.outward * midpoint).distance_mm < 0 ? inside : outside) = midpoint;
  }
  return start + visit.outward * outside;
}

double smooth(double t) {
  return t * t * (3 - 2 * std::clamp(t, 0.0, 1.0));
}

/// Height above the surface (negative: depth) and length of the stroke at time `t` of a visit, s.
struct Stage {
  double height_mm, stroked;
};
constexpr double kVisit_s = 2.4, kClearance_mm = 16;
Stage stage(double t, double depth_mm) {
  if (t < 0.6) return {kClearance_mm * (1 - smooth(t / 0.6)), 0};
  if (t < 0.9) return {-depth_mm * smooth((t - 0.6) / 0.3), 0};
  if (t < 1.6) return {-depth_mm, smooth((t - 0.9) / 0.7)};
  if (t < 1.8) return {-depth_mm, 1};
  return {-depth_mm + (depth_mm + kClearance_mm) * smooth((t - 1.8) / 0.6), 1};
}

std::vector<Point<Patient>> tip_positions() {
  std::vector<Point<Patient>> tips;
  std::uint32_t random = 7;
  for (const Visit& visit : visits()) {
    const Point<Patient> start =
        visit.surface == Point<Patient>(0, 0, 0) ? Point<Patient>(-4, 1, -18) : visit.surface;
    for (int i = 0; i < static_cast<int>(kVisit_s * 1000); ++i) {
      const Stage now = stage(i * 1e-3, visit.depth_mm);
      const Point<Patient> foot = find_surface(visit, start + visit.stroke * now.stroked);
      tips.push_back(foot + visit.outward * (now.height_mm + 0.01 * noise(random)));
    }
  }
  return tips;
}

constexpr double kContinuous_N = 1.4;

DeviceTick touch(const Model& model, const Point<Patient>& tip, double limit_N) {
  DeviceTick device;
  const Nearest site = nearest(tip);
  device.tip_patient_mm = {tip.x(), tip.y(), tip.z()};
  const Point<World> tip_world = model.X_WorldPatient * tip;
  device.tip_world_mm = {tip_world.x(), tip_world.y(), tip_world.z()};
  device.proxy_patient_mm = device.tip_patient_mm;
  device.peak_force_N = 8.5;
  device.continuous_force_N = kContinuous_N;
  device.limit_N = limit_N;
  if (!(site.distance_mm < 0.1)) return device;

  // the gradient of the distance is the outward normal
  Vector<Patient> normal;
  for (int axis = 0; axis < 3; ++axis) {
    Vector<Patient> step;
    step[axis] = 1e-3;
    normal[axis] = nearest(tip + step).distance_mm - nearest(tip - step).distance_mm;
  }
  normal = normal.normalized();
  device.label = site.label;
  device.depth_mm = -site.distance_mm;
  device.normal_patient = {normal.x(), normal.y(), normal.z()};
  device.unclamped_force_N = 2 * std::max(0.0, 0.1 - site.distance_mm);
  const double sent_N = std::min(device.unclamped_force_N, limit_N);
  const Vector<World> force = model.X_WorldPatient * (normal * sent_N);
  device.force_N = {force.x(), force.y(), force.z()};
  // contact point
  for (std::size_t axis = 0; axis < 3; ++axis)
    device.proxy_patient_mm[axis] =
        device.tip_patient_mm[axis] + device.normal_patient[axis] * device.depth_mm;
  device.flags = kFlagContact;
  if (device.unclamped_force_N > limit_N) device.flags |= kFlagClamped;
  return device;
}

RecordingHeader header(const Model& model) {
  RecordingHeader header;
  header.palpate_version = "0.1.0";
  header.commit = "0123456789ab";
  header.build_type = "Release";
  header.compiler = "GNU 12.2.0";
  header.simd_target = "AVX2";
  header.started_utc = "2024-05-17T09:30:00Z";
  header.data_set = "example";
  header.scene_title = model.title;
  header.model_hash = model.content_hash;
  header.device = "premium-1.5";
  header.hand = "firm-grip";
  header.seed = 20240517;
  header.script_text = "title = \"Every structure once\"\n\n[[step]]\napproach = \"tibia\"\n";
  for (const Segment& segment : model.segments) {
    header.structures.push_back({segment.id, segment.name, "bone", segment.colour});
  }
  return header;
}

}  // namespace

Model model() {
  GridGeometry grid;
  grid.dims = {74, 68, 80};
  grid.spacing_mm = Eigen::Vector3d::Constant(1.5);
  grid.direction = Eigen::Vector3d(-1, 1, 1).asDiagonal();
  grid.origin = Point<Patient>(54.75, -52.25, -59.25);
  Volume<LabelId> labels(grid);
  Volume<float> scan(grid);
  const Transform<Patient, Voxel> X_PatientVoxel = grid.X_PatientVoxel();
  std::uint32_t random = 1;
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i) {
        const Point<Patient> p = X_PatientVoxel * Point<Voxel>(i, j, k);
        const Nearest site = nearest(p);
        if (site.distance_mm <= 0) labels.at(i, j, k) = site.label;
        scan.at(i, j, k) = static_cast<float>(std::max(0.0, intensity(p, site) + 18 * noise(random)));
      }
    }
  }

  Model model;
  model.title = "Example knee";
  model.content_hash = 0x5eed5eed5eed5eedull;
  model.side = Side::kLeft;
  model.labels = label_bricks(labels);
  model.scan = std::make_shared<const Volume<float>>(std::move(scan));
  model.segments = {{kFemoralCartilage, "femoral_cartilage", {110, 150, 250}, 0, kFemoralCartilage},
                    {kFemur, "femur", {214, 190, 140}, 0, kFemur},
                    {kTibia, "tibia", {220, 140, 90}, 0, kTibia},
                    {kFibula, "fibula", {130, 190, 120}, 0, kFibula},
                    {kPatella, "patella", {200, 110, 150}, 0, kPatella}};
  model.tissues.resize(1);
  model.tissue_of_label.assign(kPatella + 1, -1);
  for (const Segment& segment : model.segments) model.tissue_of_label[segment.id] = 0;
  model.X_WorldPatient = supine_from_feet(grid);
  return model;
}

Recording recording(const Model& model, double limit_N) {
  Recording recording;
  recording.header = header(model);
  const std::vector<Point<Patient>> tips = tip_positions();
  RecordingSummary summary;
  double heat = 0;
  for (std::size_t i = 0; i < tips.size(); ++i) {
    TickRecord tick;
    tick.tick = i;
    tick.time_s = 1e-3 * static_cast<double>(i);
    tick.dt_s = 1e-3;
    tick.max_force_N = limit_N;
    tick.device[0] = touch(model, tips[i], limit_N);
    // velocity over 10 ms, as in the servo
    const Vector<Patient> moved = i >= 10 ? tips[i] - tips[i - 10] : Vector<Patient>();
    if (moved.norm() < 5)
      tick.device[0].velocity_patient_mm_s = {100 * moved.x(), 100 * moved.y(), 100 * moved.z()};
    // thermal model of the motors with a time constant of 10 s
    const double power = std::min(tick.device[0].unclamped_force_N, limit_N) / kContinuous_N;
    heat += (power * power - heat) * tick.dt_s / 10;
    tick.device[0].heat = heat;
    summary.observe(tick);
    recording.ticks.push_back(tick);
  }
  summary.run_hash = 0x0123456789abcdefull;
  summary.problems = {"script line 9: asked for 2.00 N, felt 1.50 N on patella"};
  recording.summary = summary;
  return recording;
}

Recording real_recording(const Model& model) {
  Recording recording = example::recording(model);
  RecordingHeader& header = recording.header;
  header.clock = "real";
  header.scheduler = "SCHED_FIFO 80";
  RecordingSummary summary;
  summary.run_hash = 0;
  summary.skipped = 3;
  std::uint32_t random = 3;
  for (std::size_t i = 0; i < recording.ticks.size(); ++i) {
    TickRecord& tick = recording.ticks[i];
    tick.lateness_s = (12 + 4 * noise(random)) * 1e-6;
    tick.compute_s = (9 + 2 * noise(random)) * 1e-6;
    // preempted by another thread
    if (i % 1000 == 700) tick.lateness_s = 300e-6;
    if (i == 4700) tick.lateness_s = 3400e-6;
    // a slow bus, and the emergency stop at the end
    DeviceTick& device = tick.device[0];
    if (i >= 3000 && i < 3006) device.flags |= kFlagStale;
    if (i >= 9400) {
      device.flags |= kFlagEmergencyStop;
      device.force_N = {};
      device.limit_N = 0;
    }
    summary.observe(tick);
  }
  recording.summary = summary;
  return recording;
}

Model with_soft_tibia(Model model) {
  const GridGeometry& grid = model.labels->geometry();
  Volume<LabelId> labels(grid);
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const LabelId label = model.labels->at(i, j, k);
        // stiff bone below the soft part supports it
        const bool shaft = label == kTibia && (grid.X_PatientVoxel() * Point<Voxel>(i, j, k)).z() < -26;
        labels.at(i, j, k) = shaft ? kFibula : label;
      }
  model.labels = label_bricks(labels);
  model.tissue_law = TissueLaw::kElastic;
  model.tissues.resize(2);
  model.tissues[1].elastic = ElasticConstants{60, 0.45};
  model.tissue_of_label[kTibia] = 1;
  model.tools[0].radius_mm = 4;
  return model;
}

Recording leaning_recording(const Model& model) {
  Recording recording = example::recording(model);
  for (TickRecord& tick : recording.ticks) {
    DeviceTick& device = tick.device[0];
    if (device.label == 0) continue;
    device.contact_label[0] = device.path_label[0] = device.label;
    device.contact_N[0] = std::hypot(device.force_N[0], device.force_N[1], device.force_N[2]);
    for (std::size_t axis = 0; axis < 3; ++axis)
      device.contact_patient_mm[axis] =
          device.tip_patient_mm[axis] + device.normal_patient[axis] * device.depth_mm;
    const bool both = device.label == kTibia && device.depth_mm > 0.3;
    device.path_depth_mm[0] = both ? 0.3 : std::max(0.0, device.depth_mm);
    device.path_share[0] = both ? 0.75 : 1;
    if (!both) continue;
    device.path_label[1] = kFemur;
    device.path_depth_mm[1] = device.depth_mm - 0.3;
    device.path_share[1] = 0.25;
  }
  return recording;
}

Model with_burr(Model model) {
  model.tools[0].name = "burr";
  model.tools[0].radius_mm = 2;
  model.tools[0].burr = BurrSettings{};
  return model;
}

Recording milled_recording(const Model& model) {
  Recording recording = example::recording(model);
  constexpr std::size_t kVisit = 2400, kPressed = 700, kSecond = 1000, kVersion = 40;
  std::uint32_t version = 1;
  for (const std::size_t visit : {std::size_t{0}, std::size_t{2}}) {
    const std::size_t begin = visit * kVisit + kPressed, end = begin + kSecond;
    for (std::size_t i = begin; i < end; ++i) {
      recording.ticks[i].switches |= kSwitchMotor;
      if ((i + 1 - begin) % kVersion != 0) continue;
      RecordingEvent sweep;
      sweep.kind = RecordingEvent::Kind::kSweep;
      sweep.tick = i;
      sweep.number = ++version;
      sweep.sweep = {0, recording.ticks[i + 1 - kVersion].device[0].tip_patient_mm,
                     recording.ticks[i].device[0].tip_patient_mm, model.tools[0].radius_mm};
      RecordingEvent cut;
      cut.tick = i;
      cut.number = cut.change.version = version;
      cut.change.tissue = ModelChange::kCut;
      recording.events.insert(recording.events.end(), {sweep, cut});
    }
  }
  return recording;
}

PlanInScene plan(const Model& model) {
  const auto file = parse_plan(R"(title = "A <plan>"
[[trajectory]]
name = "way & target"
entry = [1, -35, 13]
target = [1, -30, 13]
enters = ["patella"]
entry_within = 0.5
depth_within = 20
[[region]]
name = "piece"
shape = "sphere"
trajectory = "way & target"
radius = 2
[[keep_away]]
structures = ["fibula"]
distance = 2
)",
                               "plan.toml");
  PALPATE_CHECK(file.ok());
  auto found = resolve_plan(*file, model);
  PALPATE_CHECK(found.ok());
  return *std::move(found);
}

}  // namespace palpate::report::example
