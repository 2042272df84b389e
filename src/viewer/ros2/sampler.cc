#include "ros2/sampler.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "palpate/json/json.h"

namespace palpate::ros2 {
namespace {

Eigen::Vector3d vector_of(const std::array<double, 3>& numbers) {
  return {numbers[0], numbers[1], numbers[2]};
}
std::array<double, 3> numbers_of(const Eigen::Vector3d& vector) {
  return {vector.x(), vector.y(), vector.z()};
}
Eigen::Quaterniond quaternion_of(const std::array<double, 4>& wxyz) {
  const Eigen::Quaterniond turn(wxyz[0], wxyz[1], wxyz[2], wxyz[3]);
  return turn.norm() > 0 ? turn.normalized() : Eigen::Quaterniond::Identity();
}
std::array<double, 4> xyzw(const Eigen::Quaterniond& turn) {
  return {turn.x(), turn.y(), turn.z(), turn.w()};
}

}  // namespace

Sampler::Sampler(const ViewedScene& scene) : scene_(scene) {}

bool Sampler::convert(const TickRecord& tick, std::size_t device, HandSample& sample) const {
  const DeviceTick& from = tick.device[device];
  const Eigen::Vector3d tip_mm = vector_of(from.tip_patient_mm), force_N = vector_of(from.force_N);
  if (!tip_mm.allFinite() || !force_N.allFinite()) return false;
  Eigen::Matrix3d R_WorldPatient;
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t c = 0; c < 3; ++c)
      R_WorldPatient(static_cast<int>(r), static_cast<int>(c)) = scene_.world_from_patient[r][c];
  const Eigen::Quaterniond R_PatientWorld(
      (quaternion_of(tick.rotation_applied_wxyz) * R_WorldPatient).transpose());

  sample.tool.position_m = numbers_of(tip_mm / kMetre_mm);
  sample.tool.orientation_xyzw = xyzw(R_PatientWorld * quaternion_of(from.orientation_wxyz));
  sample.proxy.position_m = numbers_of(vector_of(from.proxy_patient_mm) / kMetre_mm);
  sample.proxy.orientation_xyzw = sample.tool.orientation_xyzw;
  sample.velocity_m_s = numbers_of(vector_of(from.velocity_patient_mm_s) / kMetre_mm);
  sample.angular_velocity_rad_s = numbers_of(R_PatientWorld * vector_of(from.angular_velocity_world_rad_s));
  sample.force_N = numbers_of(R_PatientWorld * force_N);
  sample.torque_Nm = numbers_of(R_PatientWorld * vector_of(from.torque_Nmm) / kMetre_mm);

  sample.distances.clear();
  for (std::size_t n = 0; n < kMaxNearReported && from.near_label[n] != 0; ++n) {
    const auto near = std::ranges::find(scene_.structures, from.near_label[n], &ViewedStructure::label);
    if (near != scene_.structures.end())
      sample.distances.emplace_back(near->name, from.near_mm[n] / kMetre_mm);
  }
  const std::size_t no_go = from.no_go;
  sample.no_go = no_go > 0 && no_go <= scene_.no_go.size() ? scene_.no_go[no_go - 1].name : "";
  sample.no_go_depth_m = from.no_go_depth_mm / kMetre_mm;
  sample.no_go_N = from.no_go_N;
  return true;
}

PoseSample patient_in_base() {
  // columns: left, posterior and superior by anterior, left and superior
  Eigen::Matrix3d R_BasePatient;
  R_BasePatient << 0, -1, 0,  //
      1, 0, 0,                //
      0, 0, 1;
  return {{0, 0, 0}, xyzw(Eigen::Quaterniond(R_BasePatient))};
}

std::string scene_text(const ViewedScene& scene) {
  Json structures = Json::array();
  for (const ViewedStructure& structure : scene.structures)
    structures.push_back({{"label", structure.label}, {"name", structure.name}});
  return Json({{"structures", structures}}).dump();
}

std::int64_t TickClock::stamp_ns(double tick_time_s, std::int64_t now_ns) {
  // a clock that runs 100 ppm faster than the other is followed; more than 20 ms is an adjusted clock or
  // another run
  constexpr std::int64_t kTicksPerDrift = 10'000, kMaxAge_ns = 20'000'000;
  const std::int64_t tick_ns = std::llround(1e9 * tick_time_s), difference_ns = now_ns - tick_ns;
  const std::int64_t elapsed_ns = tick_ns - last_tick_ns_;
  const std::int64_t followed_ns = offset_ns_ + elapsed_ns / kTicksPerDrift;
  const bool is_other_run = last_tick_ns_ < 0 || elapsed_ns < 0 || difference_ns > followed_ns + kMaxAge_ns;
  offset_ns_ = is_other_run ? difference_ns : std::min(difference_ns, followed_ns);
  last_tick_ns_ = tick_ns;
  return tick_ns + offset_ns_;
}

}  // namespace palpate::ros2
