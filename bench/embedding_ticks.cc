#include <algorithm>
#include <cstdint>
#include <memory>
#include <vector>

#include "palpate.h"
#include "palpate/loading/loading.h"
#include "palpate/recording/recording.h"
#include "palpate/servo/servo.h"

/// Loaded by embedding.py: loops of ticks in C++ and in C, without Python between the ticks.

namespace {

struct CppSession {
  std::shared_ptr<const palpate::Model> model;
  palpate::Parameters parameters;
  palpate::SessionState state;
  palpate::TickRecord record;
  std::uint64_t run_hash = 0;
};

}  // namespace

extern "C" {

/// A session in C++, of one device in World with the proxy; null where the scene cannot be loaded.
void* bench_cpp_open(const char* scene) {
  const auto loaded = palpate::load_scene_or_data_set({scene});
  if (!loaded) return nullptr;
  const palpate::ForceMethod method = palpate::ForceMethod::kProxy;
  auto ready = palpate::prepared_with_cache(loaded->model, {&method, 1});
  if (!ready) return nullptr;
  auto session = std::make_unique<CppSession>();
  session->model = *std::move(ready);
  session->parameters.method = method;
  return session.release();
}

void bench_cpp_close(void* session) {
  delete static_cast<CppSession*>(session);
}

/// @param tips_mm  3 * ticks, in World
void bench_cpp_ticks(void* opaque, const double* tips_mm, std::size_t ticks, double dt_s) {
  CppSession& session = *static_cast<CppSession*>(opaque);
  palpate::DeviceState device;
  palpate::Wrench wrench;
  for (std::size_t n = 0; n < ticks; ++n) {
    device.tip = palpate::Point<palpate::World>(Eigen::Vector3d(tips_mm + 3 * n));
    palpate::tick(*session.model, session.parameters, {&device, 1}, dt_s, session.state, {&wrench, 1},
                  session.record);
    session.run_hash = palpate::mix_run_hash(session.run_hash, session.record.state_hash);
  }
}

/// The same, and keeps what every tick did. Returns the deepest penetration.
double bench_cpp_run(void* opaque, const double* tips_mm, std::size_t ticks, double dt_s) {
  std::vector<palpate::DeviceTick> records(ticks);
  CppSession& session = *static_cast<CppSession*>(opaque);
  for (std::size_t n = 0; n < ticks; ++n) {
    bench_cpp_ticks(opaque, tips_mm + 3 * n, 1, dt_s);
    records[n] = session.record.device[0];
  }
  double depth_mm = 0;
  for (const palpate::DeviceTick& record : records) depth_mm = std::max<double>(depth_mm, record.depth_mm);
  return depth_mm;
}

std::uint64_t bench_cpp_hash(const void* session) {
  return static_cast<const CppSession*>(session)->run_hash;
}

/// The same through palpate.h, as a program in C calls it.
/// @param tick  plp_session_tick of the library that has the session
int bench_c_ticks(plp_session* session, decltype(&plp_session_tick) tick, const double* tips_mm,
                  std::size_t ticks, double dt_s) {
  plp_pose pose{};
  pose.size = sizeof pose;
  pose.orientation_wxyz[0] = 1;
  plp_wrench wrench{};
  wrench.size = sizeof wrench;
  for (std::size_t n = 0; n < ticks; ++n) {
    for (std::size_t axis = 0; axis < 3; ++axis) pose.tip_mm[axis] = tips_mm[3 * n + axis];
    if (const plp_status status = tick(session, &pose, dt_s, &wrench); status != PLP_OK) return status;
  }
  return PLP_OK;
}

}  // extern "C"
