#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "ros2/samples.h"

/// The part of the publisher that needs Cyclone DDS: a library of its own, libpalpate_ros2.so, which is
/// loaded when a session is published.
namespace palpate::ros2 {

struct DdsOptions {
  int domain = 0;
  std::string interface;  ///< Name or address; empty: loopback
  std::size_t hands = 1;
  bool has_virtual_time = false;  ///< Whether /clock is published
  bool has_servo_cp = false;      ///< Whether the first hand is moved by servo_cp
};

/// Severity of a DiagnosticStatus.
enum class Level : std::uint8_t { kOk = 0, kWarning = 1, kError = 2 };
struct Diagnosis {
  Level level = Level::kOk;
  std::string message;
  std::vector<std::pair<std::string, std::string>> values;
};

/// Writers and readers of a session's topics. One thread.
class DdsSession {
 public:
  virtual ~DdsSession() = default;
  /// Publishes measured_cp, measured_cv, measured_cf, setpoint_cp and distances of a hand, and its transform
  /// in /tf.
  virtual void publish(std::size_t hand, std::int64_t stamp_ns, const HandSample& sample) = 0;
  virtual void publish_clock(std::int64_t time_ns) = 0;
  virtual void publish(std::int64_t stamp_ns, const Diagnosis& diagnosis) = 0;
  /// Publishes the text of /palpate/scene, and in /tf_static the pose of the patient's frame in the base
  /// frame. Late subscribers get both.
  virtual void publish_scene(std::int64_t stamp_ns, const std::string& text,
                             const PoseSample& patient_in_base) = 0;
  /// Whether a message has arrived at /palpate/stop since the last call.
  virtual bool read_stop() = 0;
  /// Latest position that has arrived at servo_cp of the first hand since the last call, in the patient; m.
  /// Messages in other frames are ignored.
  virtual std::optional<std::array<double, 3>> read_servo_cp() = 0;
};

}  // namespace palpate::ros2

/// Opens the session of libpalpate_ros2.so.
/// @return null on failure, with the reason in `fault`
extern "C" __attribute__((visibility("default"))) palpate::ros2::DdsSession* palpate_ros2_open(
    const palpate::ros2::DdsOptions& options, std::string& fault);
