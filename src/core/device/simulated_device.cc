#include <algorithm>
#include <cmath>

#include "palpate/device/simulated_device.h"

namespace palpate {
namespace {

constexpr double kMetresPerMm = 1e-3;
constexpr double kStep_s = 1e-5;

template <class Named>
Result<Named> find_named(const std::vector<Named>& known, const std::string& name, const char* kind) {
  const auto found = std::find_if(known.begin(), known.end(), [&](const Named& n) { return n.name == name; });
  if (found != known.end()) return *found;
  std::string names;
  for (const Named& n : known) names += (names.empty() ? "" : ", ") + n.name;
  return Error{ErrorKind::kBadInput, std::string("unknown ") + kind + " '" + name + "'", "",
               "known are: " + names};
}

// an encoder reports whole steps
Eigen::Vector3d quantised(const Eigen::Vector3d& position_m, double step_m) {
  return step_m > 0 ? Eigen::Vector3d((position_m / step_m).array().floor() * step_m) : position_m;
}

Eigen::Vector3d saturated(const Eigen::Vector3d& force_N, double peak_N) {
  const double magnitude = force_N.norm();
  return magnitude > peak_N ? Eigen::Vector3d(force_N * (peak_N / magnitude)) : force_N;
}

}  // namespace

const std::vector<PlantDevice>& known_plant_devices() {
  // mass kg, damping N.s/m, Coulomb N, encoder step m, peak N, continuous N, reach m; the stiffness that the
  // vendors vouch for is not known
  static const std::vector<PlantDevice> devices{
      {"premium-1.5", 0.075, 0.005, 0.04, 30e-6, 8.5, 1.4, 0.12},
      {"touch", 0.045, 0.1, 0.26, 55e-6, 3.3, 0.88, 0.075},
  };
  return devices;
}

const std::vector<PlantHand>& known_plant_hands() {
  // mass kg, damping N.s/m, stiffness N/m
  static const std::vector<PlantHand> hands{
      {"light-grip", 0.15, 2, 80},
      {"firm-grip", 0.15, 6, 500},
      {"whole-arm", 0.554, 6.45, 135},
  };
  return hands;
}

const std::vector<PlantHand>& plant_hands_with_skin() {
  // mass kg, damping N.s/m, stiffness N/m, then stiffness and damping between hand and device, N/m and N.s/m:
  // a finger pad has about 1000 and 1 (Wiertlewski & Hayward 2012), and a pen is held by two or three
  static const std::vector<PlantHand> hands{
      {"pen-grip", 0.15, 2, 80, 2000, 0.5},
      {"firm-pen-grip", 0.15, 6, 500, 2000, 0.5},
      {"fingertip", 0.02, 1, 200, 1000, 1},
  };
  return hands;
}

Result<PlantDevice> find_plant_device(const std::string& name) {
  return find_named(known_plant_devices(), name, "device");
}

Result<PlantHand> find_plant_hand(const std::string& name) {
  return find_named(known_plant_hands(), name, "hand");
}

SimulatedDevice::SimulatedDevice(const PlantDevice& device, const PlantHand& hand, double delay_s)
    : device_(device), hand_(hand), delay_s_(delay_s >= 0 ? std::min(delay_s, kMaxDelay_s) : 0) {
  push({0, Eigen::Vector3d::Zero()});
}

DeviceInfo SimulatedDevice::info() const {
  DeviceInfo info;
  info.name = device_.name + " (simulated)";
  info.simulated = true;
  info.peak_force_N = device_.peak_force_N;
  info.continuous_force_N = device_.continuous_force_N;
  info.position_step_mm = device_.encoder_step_m / kMetresPerMm;
  if (!std::isnan(device_.stiffness_N_per_mm)) info.stiffness_N_per_mm = device_.stiffness_N_per_mm;
  if (!std::isnan(device_.reach_m)) {
    const double half_mm = device_.reach_m / kMetresPerMm / std::sqrt(3.0);
    info.workspace = {Point<Device>(-half_mm, -half_mm, -half_mm), Point<Device>(half_mm, half_mm, half_mm)};
  }
  return info;
}

void SimulatedDevice::reset(const Point<Device>& tip) {
  if (!tip.all_finite()) return;
  target_mm_ = previous_target_mm_ = tip;
  position_m_ = tip.eigen() * kMetresPerMm;
  velocity_m_s_.setZero();
  hand_m_ = position_m_;
  hand_m_s_.setZero();
  time_s_ = work_mJ_ = 0;
  first_ = count_ = 0;
  push({0, Eigen::Vector3d::Zero()});
}

// overwrites the oldest command if ticks are shorter than the capacity is designed for
void SimulatedDevice::push(const Command& command) {
  if (count_ == delay_line_.size()) {
    first_ = (first_ + 1) % delay_line_.size();
    --count_;
  }
  delay_line_[(first_ + count_) % delay_line_.size()] = command;
  ++count_;
}

// newest command whose time has come
const SimulatedDevice::Command& SimulatedDevice::acting_at(double time_s) {
  while (count_ > 1 && delay_line_[(first_ + 1) % delay_line_.size()].from_s <= time_s) {
    first_ = (first_ + 1) % delay_line_.size();
    --count_;
  }
  return delay_line_[first_];
}

DeviceSample SimulatedDevice::read() const {
  DeviceSample sample;
  sample.tip = Point<Device>(quantised(position_m_, device_.encoder_step_m) / kMetresPerMm);
  return sample;
}

Point<Device> SimulatedDevice::true_tip() const {
  return Point<Device>(position_m_ / kMetresPerMm);
}

Vector<Device> SimulatedDevice::true_velocity_mm_s() const {
  return Vector<Device>(velocity_m_s_ / kMetresPerMm);
}

void SimulatedDevice::advance(const DeviceCommand& command, double dt_s) {
  work_mJ_ = 0;
  if (!(dt_s > 0 && dt_s <= kMaxAdvance_s)) return;
  const Eigen::Vector3d commanded_N =
      command.force_N.all_finite() ? command.force_N.eigen() : Eigen::Vector3d::Zero();
  push({time_s_ + delay_s_, saturated(commanded_N, device_.peak_force_N)});

  const bool has_skin = hand_.has_skin();
  const double mass_kg = has_skin ? device_.mass_kg : device_.mass_kg + hand_.mass_kg;
  const Eigen::Vector3d from_m = previous_target_mm_.eigen() * kMetresPerMm;
  const Eigen::Vector3d intended_velocity_m_s =
      (target_mm_ - previous_target_mm_).eigen() * kMetresPerMm / dt_s;
  const int steps = std::max(1, static_cast<int>(std::lround(dt_s / kStep_s)));
  const double h = dt_s / steps;
  for (int i = 0; i < steps; ++i) {
    // zero-order hold
    const Eigen::Vector3d& sustained_N = acting_at(time_s_ + (i + 0.5) * h).force_N;

    // spring and damper from the intended motion to the hand, those of the skin to the device if there is
    // skin, the device's damping, then Coulomb friction as an impulse that can at most stop the motion
    // (stick)
    const Eigen::Vector3d intended_m = from_m + intended_velocity_m_s * ((i + 1) * h);
    const Eigen::Vector3d& guided_m = has_skin ? hand_m_ : position_m_;
    const Eigen::Vector3d& guided_m_s = has_skin ? hand_m_s_ : velocity_m_s_;
    const Eigen::Vector3d hand_N = hand_.stiffness_N_per_m * (intended_m - guided_m) +
                                   hand_.damping_N_s_per_m * (intended_velocity_m_s - guided_m_s);
    Eigen::Vector3d held_by_N = hand_N;
    if (has_skin) {
      held_by_N =
          hand_.skin_N_per_m * (hand_m_ - position_m_) + hand_.skin_N_s_per_m * (hand_m_s_ - velocity_m_s_);
      hand_m_s_ += (hand_N - held_by_N) * (h / hand_.mass_kg);
      hand_m_ += hand_m_s_ * h;
    }
    const Eigen::Vector3d force_N = sustained_N + held_by_N - device_.damping_N_s_per_m * velocity_m_s_;
    velocity_m_s_ += force_N * (h / mass_kg);
    const double speed = velocity_m_s_.norm();
    const double friction_step = device_.coulomb_N * h / mass_kg;
    velocity_m_s_ *= speed > friction_step ? 1 - friction_step / speed : 0;
    position_m_ += velocity_m_s_ * h;
    work_mJ_ += sustained_N.dot(velocity_m_s_) * h * 1e3;
  }
  time_s_ += dt_s;
  previous_target_mm_ = target_mm_;
}

}  // namespace palpate
