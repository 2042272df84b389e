#include "ros2/dds_session.h"

#include <dds/dds.h>

#include <array>
#include <atomic>
#include <new>
#include <string_view>

#include "messages.h"

namespace palpate::ros2 {
namespace {

constexpr dds_duration_t kMaxBlocking = DDS_MSECS(1);
constexpr std::int32_t kShortHistory = 1, kDiagnosticHistory = 10;
constexpr std::int64_t kSecond_ns = 1'000'000'000;

using Entity = dds_entity_t;

struct DeleteQos {
  void operator()(dds_qos_t* qos) const { dds_delete_qos(qos); }
};
using Qos = std::unique_ptr<dds_qos_t, DeleteQos>;

enum class Delivery { kBestEffort, kReliable, kTransientLocal };
Qos qos_of(Delivery delivery, std::int32_t history) {
  Qos qos(dds_create_qos());
  if (qos == nullptr) throw std::bad_alloc();
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, history);
  dds_qset_reliability(
      qos.get(), delivery == Delivery::kBestEffort ? DDS_RELIABILITY_BEST_EFFORT : DDS_RELIABILITY_RELIABLE,
      kMaxBlocking);
  dds_qset_durability(qos.get(), delivery == Delivery::kTransientLocal ? DDS_DURABILITY_TRANSIENT_LOCAL
                                                                       : DDS_DURABILITY_VOLATILE);
  return qos;
}

// Text in double quotes as the value of an attribute.
std::string attribute(const std::string& text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"')
      quoted += "&quot;";
    else if (c == '&')
      quoted += "&amp;";
    else if (c == '<')
      quoted += "&lt;";
    else
      quoted += c;
  }
  return quoted + "\"";
}

// Configuration of Cyclone DDS, which replaces that of the environment (CYCLONEDDS_URI).
std::string configuration(const DdsOptions& options) {
  std::string general, discovery;
  if (options.interface.empty()) {
    // loopback has no multicast: participants are found at the first ports of this machine
    general =
        "<Interfaces><NetworkInterface name=\"lo\"/></Interfaces><AllowMulticast>false</AllowMulticast>";
    discovery =
        "<Peers><Peer address=\"127.0.0.1\"/></Peers><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>";
  } else {
    const bool is_address = options.interface.find_first_of(".:") != std::string::npos;
    general = std::string("<Interfaces><NetworkInterface ") + (is_address ? "address=" : "name=") +
              attribute(options.interface) + "/></Interfaces>";
  }
  return "<CycloneDDS><Domain id=\"any\"><General>" + general +
         "</General><Discovery><ParticipantIndex>auto</ParticipantIndex>" + discovery +
         "</Discovery></Domain></CycloneDDS>";
}

builtin_interfaces_msg_dds__Time_ time_of(std::int64_t stamp_ns) {
  return {static_cast<std::int32_t>(stamp_ns / kSecond_ns),
          static_cast<std::uint32_t>(stamp_ns % kSecond_ns)};
}
// Cyclone's structs have non-const char* members, but Cyclone does not write to the text.
char* text_of(const std::string& text) {
  return const_cast<char*>(text.c_str());
}
std_msgs_msg_dds__Header_ header_of(std::int64_t stamp_ns, const char* frame) {
  return {time_of(stamp_ns), const_cast<char*>(frame)};
}
geometry_msgs_msg_dds__Vector3_ vector_of(const std::array<double, 3>& v) {
  return {v[0], v[1], v[2]};
}
geometry_msgs_msg_dds__Quaternion_ quaternion_of(const std::array<double, 4>& xyzw) {
  return {xyzw[0], xyzw[1], xyzw[2], xyzw[3]};
}
geometry_msgs_msg_dds__Pose_ pose_of(const PoseSample& pose) {
  return {{pose.position_m[0], pose.position_m[1], pose.position_m[2]}, quaternion_of(pose.orientation_xyzw)};
}
/// Writer of a topic, and the number of its readers: without any, nothing is encoded.
struct Topic {
  Entity writer = 0;
  std::atomic<std::uint32_t> readers{0};

  template <class Message>
  void write(const Message& message) const {
    if (readers.load(std::memory_order_relaxed) > 0) dds_write(writer, &message);
  }
};
void count_readers(Entity, const dds_publication_matched_status_t status, void* topic) {
  static_cast<Topic*>(topic)->readers.store(status.current_count, std::memory_order_relaxed);
}

template <class Sequence, class Element>
Sequence sequence_of(std::vector<Element>& elements) {
  const auto size = static_cast<std::uint32_t>(elements.size());
  return {size, size, elements.data(), false};
}

class Session final : public DdsSession {
 public:
  ~Session() override {
    // the domain takes its participants, writers and readers along
    if (domain_ > 0) dds_delete(domain_);
  }

  // Returns the reason for a failure; empty: none.
  std::string open(const DdsOptions& options) {
    const auto silent = [](void*, const dds_log_data_t*) {};
    dds_set_log_sink(silent, nullptr);
    dds_set_trace_sink(silent, nullptr);
    const auto number = static_cast<dds_domainid_t>(options.domain);
    domain_ = dds_create_domain(number, configuration(options).c_str());
    if (domain_ < 0) return failure("domain", domain_);
    const Qos qos(dds_create_qos());
    // ROS 2 recognises a participant without a security enclave by this user data
    constexpr std::string_view kEnclave = "enclave=/;";
    dds_qset_userdata(qos.get(), kEnclave.data(), kEnclave.size());
    participant_ = dds_create_participant(number, qos.get(), nullptr);
    if (participant_ < 0) return failure("participant", participant_);

    hands_ = std::vector<Hand>(options.hands);
    for (std::size_t n = 0; n < options.hands; ++n) {
      const std::string prefix = "rt/palpate/hand" + std::to_string(n + 1) + "/";
      Hand& hand = hands_[n];
      hand.frame = "palpate/hand" + std::to_string(n + 1);
      advertise(hand.measured_cp, geometry_msgs_msg_dds__PoseStamped__desc, prefix + "measured_cp",
                Delivery::kBestEffort);
      advertise(hand.measured_cv, geometry_msgs_msg_dds__TwistStamped__desc, prefix + "measured_cv",
                Delivery::kBestEffort);
      advertise(hand.measured_cf, geometry_msgs_msg_dds__WrenchStamped__desc, prefix + "measured_cf",
                Delivery::kBestEffort);
      advertise(hand.setpoint_cp, geometry_msgs_msg_dds__PoseStamped__desc, prefix + "setpoint_cp",
                Delivery::kBestEffort);
      advertise(hand.distances, palpate_msgs_msg_dds__Distances__desc, prefix + "distances",
                Delivery::kBestEffort);
    }
    // listeners of ROS 2's tf2 ask for reliable delivery
    advertise(tf_, tf2_msgs_msg_dds__TFMessage__desc, "rt/tf", Delivery::kReliable);
    tf_static_ = writer(tf2_msgs_msg_dds__TFMessage__desc, "rt/tf_static", Delivery::kTransientLocal);
    scene_ = writer(std_msgs_msg_dds__String__desc, "rt/palpate/scene", Delivery::kTransientLocal);
    diagnostics_ = writer(diagnostic_msgs_msg_dds__DiagnosticArray__desc, "rt/diagnostics",
                          Delivery::kReliable, kDiagnosticHistory);
    if (options.has_virtual_time)
      clock_ = writer(rosgraph_msgs_msg_dds__Clock__desc, "rt/clock", Delivery::kBestEffort);
    // DDS does not match a reliable reader with a best-effort writer, and a stop must arrive as reliably as
    // the writer permits: hence one reader of each kind
    stops_ = {reader(std_msgs_msg_dds__Empty__desc, "rt/palpate/stop", Delivery::kReliable),
              reader(std_msgs_msg_dds__Empty__desc, "rt/palpate/stop", Delivery::kBestEffort)};
    // a best-effort reader matches writers of either kind
    if (options.has_servo_cp)
      servo_cp_ = reader(geometry_msgs_msg_dds__PoseStamped__desc, "rt/palpate/hand1/servo_cp",
                         Delivery::kBestEffort);
    return fault_;
  }

  void publish(std::size_t n, std::int64_t stamp_ns, const HandSample& sample) override {
    Hand& hand = hands_[n];
    const std_msgs_msg_dds__Header_ header = header_of(stamp_ns, kPatientFrame);
    const geometry_msgs_msg_dds__PoseStamped_ tool{header, pose_of(sample.tool)},
        proxy{header, pose_of(sample.proxy)};
    hand.measured_cp.write(tool);
    hand.setpoint_cp.write(proxy);
    const geometry_msgs_msg_dds__TwistStamped_ twist{
        header, {vector_of(sample.velocity_m_s), vector_of(sample.angular_velocity_rad_s)}};
    hand.measured_cv.write(twist);
    const geometry_msgs_msg_dds__WrenchStamped_ wrench{
        header, {vector_of(sample.force_N), vector_of(sample.torque_Nm)}};
    hand.measured_cf.write(wrench);

    std::vector<char*> names;
    std::vector<double> distances;
    for (const auto& [name, distance_m] : sample.distances) {
      names.push_back(text_of(name));
      distances.push_back(distance_m);
    }
    const palpate_msgs_msg_dds__Distances_ near{header,
                                                sequence_of<dds_sequence_string>(names),
                                                sequence_of<dds_sequence_double>(distances),
                                                text_of(sample.no_go),
                                                sample.no_go_depth_m,
                                                sample.no_go_N};
    hand.distances.write(near);
    if (tf_.readers > 0) publish_transform(tf_.writer, header, hand.frame, sample.tool);
  }

  void publish_clock(std::int64_t time_ns) override {
    const rosgraph_msgs_msg_dds__Clock_ clock{time_of(time_ns)};
    dds_write(clock_, &clock);
  }

  void publish(std::int64_t stamp_ns, const Diagnosis& diagnosis) override {
    std::vector<diagnostic_msgs_msg_dds__KeyValue_> values;
    for (const auto& [key, value] : diagnosis.values) values.push_back({text_of(key), text_of(value)});
    std::string name = "palpate: session";
    std::vector<diagnostic_msgs_msg_dds__DiagnosticStatus_> status{
        {static_cast<std::uint8_t>(diagnosis.level), name.data(), text_of(diagnosis.message),
         const_cast<char*>(""), sequence_of<dds_sequence_diagnostic_msgs_msg_dds__KeyValue_>(values)}};
    const diagnostic_msgs_msg_dds__DiagnosticArray_ array{
        header_of(stamp_ns, ""),
        sequence_of<dds_sequence_diagnostic_msgs_msg_dds__DiagnosticStatus_>(status)};
    dds_write(diagnostics_, &array);
  }

  void publish_scene(std::int64_t stamp_ns, const std::string& text,
                     const PoseSample& patient_in_base) override {
    const std_msgs_msg_dds__String_ scene{text_of(text)};
    dds_write(scene_, &scene);
    publish_transform(tf_static_, header_of(stamp_ns, kBaseFrame), kPatientFrame, patient_in_base);
  }

  bool read_stop() override {
    bool stop = false;
    for (const Entity reader : stops_) take(reader, [&stop](const void*) { stop = true; });
    return stop;
  }

  std::optional<std::array<double, 3>> read_servo_cp() override {
    std::optional<std::array<double, 3>> latest;
    if (servo_cp_ == 0) return latest;
    take(servo_cp_, [&latest](const void* sample) {
      const auto& pose = *static_cast<const geometry_msgs_msg_dds__PoseStamped_*>(sample);
      if (pose.header.frame_id != nullptr && std::string_view(pose.header.frame_id) == kPatientFrame)
        latest = {pose.pose.position.x, pose.pose.position.y, pose.pose.position.z};
    });
    return latest;
  }

 private:
  struct Hand {
    std::string frame;
    Topic measured_cp, measured_cv, measured_cf, setpoint_cp, distances;
  };

  static std::string failure(const char* what, dds_return_t code) {
    return std::string(what) + ": " + dds_strretcode(-code);
  }
  // Notes the first failure.
  Entity checked(Entity entity) {
    if (entity < 0 && fault_.empty()) fault_ = failure("topic", entity);
    return entity;
  }
  Entity writer(const dds_topic_descriptor_t& type, const std::string& name, Delivery delivery,
                std::int32_t history = kShortHistory, const dds_listener_t* listener = nullptr) {
    const Entity topic = checked(dds_create_topic(participant_, &type, name.c_str(), nullptr, nullptr));
    const Qos qos = qos_of(delivery, history);
    return checked(dds_create_writer(participant_, topic, qos.get(), listener));
  }
  Entity reader(const dds_topic_descriptor_t& type, const char* name, Delivery delivery) {
    const Entity topic = checked(dds_create_topic(participant_, &type, name, nullptr, nullptr));
    const Qos qos = qos_of(delivery, kShortHistory);
    return checked(dds_create_reader(participant_, topic, qos.get(), nullptr));
  }
  // Calls use(sample) for each message that a reader has received.
  template <class Use>
  static void take(Entity reader, const Use& use) {
    std::array<void*, 1> samples{};
    std::array<dds_sample_info_t, 1> infos{};
    while (dds_take(reader, samples.data(), infos.data(), infos.size(), infos.size()) > 0) {
      if (infos[0].valid_data) use(samples[0]);
      dds_return_loan(reader, samples.data(), 1);
      samples = {};
    }
  }
  // Creates the writer of a topic whose readers are counted.
  void advertise(Topic& topic, const dds_topic_descriptor_t& type, const std::string& name,
                 Delivery delivery) {
    dds_listener_t* const listener = dds_create_listener(&topic);
    dds_lset_publication_matched(listener, count_readers);
    topic.writer = writer(type, name, delivery, kShortHistory, listener);
    dds_delete_listener(listener);
  }
  static void publish_transform(Entity writer, const std_msgs_msg_dds__Header_& header,
                                const std::string& child, const PoseSample& pose) {
    std::vector<geometry_msgs_msg_dds__TransformStamped_> transforms{
        {header, text_of(child), {vector_of(pose.position_m), quaternion_of(pose.orientation_xyzw)}}};
    const tf2_msgs_msg_dds__TFMessage_ message{
        sequence_of<dds_sequence_geometry_msgs_msg_dds__TransformStamped_>(transforms)};
    dds_write(writer, &message);
  }

  Entity domain_ = 0, participant_ = 0;
  std::vector<Hand> hands_;
  Topic tf_;
  Entity tf_static_ = 0, scene_ = 0, diagnostics_ = 0, clock_ = 0;
  std::array<Entity, 2> stops_{};
  Entity servo_cp_ = 0;
  std::string fault_;  // first failure of open()
};

}  // namespace
}  // namespace palpate::ros2

palpate::ros2::DdsSession* palpate_ros2_open(const palpate::ros2::DdsOptions& options, std::string& fault) {
  auto session = std::make_unique<palpate::ros2::Session>();
  fault = session->open(options);
  return fault.empty() ? session.release() : nullptr;
}
