#include "c/record.h"

#include <algorithm>
#include <array>
#include <iterator>

namespace palpate::c {
namespace {

template <class From, std::size_t kFrom, class To, std::size_t kTo>
void copy(const std::array<From, kFrom>& from, To (&to)[kTo]) {
  static_assert(kFrom == kTo);
  std::copy(from.begin(), from.end(), std::begin(to));
}

}  // namespace

plp_record record_of(const TickRecord& tick, std::size_t device) {
  const DeviceTick& own = tick.device[device];
  plp_record record{};
  record.size = sizeof record;
  record.device = static_cast<std::uint32_t>(device);
  record.tick = tick.tick;
  record.state_hash = tick.state_hash;
  record.time_s = tick.time_s;
  record.dt_s = tick.dt_s;
  record.model_version = tick.model_version;
  record.flags = own.flags;
  record.label = own.label;
  record.method = tick.method;
  copy(own.tip_world_mm, record.tip_world_mm);
  copy(own.orientation_wxyz, record.orientation_world_wxyz);
  copy(own.force_N, record.force_world_N);
  copy(own.torque_Nmm, record.torque_world_Nmm);
  copy(own.tip_patient_mm, record.tip_patient_mm);
  copy(own.proxy_patient_mm, record.proxy_patient_mm);
  copy(own.normal_patient, record.normal_patient);
  copy(own.velocity_patient_mm_s, record.velocity_patient_mm_s);
  record.depth_mm = own.depth_mm;
  record.field = own.field;
  record.unclamped_force_N = own.unclamped_force_N;
  record.limit_N = own.limit_N;
  record.energy_mJ = own.energy_mJ;
  record.damping_N_s_per_m = own.damping_N_s_per_m;
  copy(own.contact_label, record.contact_label);
  copy(own.contact_part, record.contact_part);
  copy(own.contact_patient_mm, record.contact_patient_mm);
  copy(own.contact_N, record.contact_N);
  copy(own.path_label, record.path_label);
  copy(own.path_depth_mm, record.path_depth_mm);
  copy(own.path_share, record.path_share);
  return record;
}

}  // namespace palpate::c
