#pragma once

#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "palpate/base/check.h"

/// Node of ROS 2 on Fast DDS, a middleware other than the one that publishes. Messages are decoded byte by
/// byte, by the .msg files of ROS 2, without any of palpate's own encoding.
namespace palpate::fast_dds {

namespace dds = eprosima::fastdds::dds;
using Bytes = std::vector<unsigned char>;

inline constexpr auto kPatience = std::chrono::seconds(20);
inline constexpr std::uint32_t kMaxMessage_bytes = 1 << 16;

/// Message type that is received and sent as the bytes of its encoding.
class RawType : public dds::TopicDataType {
 public:
  explicit RawType(const std::string& name) {
    setName(name.c_str());
    m_typeSize = kMaxMessage_bytes;
    m_isGetKeyDefined = false;
  }
  bool serialize(void* data, eprosima::fastrtps::rtps::SerializedPayload_t* payload) override {
    const Bytes& bytes = *static_cast<const Bytes*>(data);
    std::memcpy(payload->data, bytes.data(), bytes.size());
    payload->length = static_cast<std::uint32_t>(bytes.size());
    return true;
  }
  bool deserialize(eprosima::fastrtps::rtps::SerializedPayload_t* payload, void* data) override {
    static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
    return true;
  }
  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return static_cast<std::uint32_t>(static_cast<const Bytes*>(data)->size()); };
  }
  void* createData() override { return new Bytes; }
  void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
  bool getKey(void*, eprosima::fastrtps::rtps::InstanceHandle_t*, bool) override { return false; }
};

/// Reader of little-endian CDR, the encoding of DDS.
class Cdr {
 public:
  explicit Cdr(Bytes bytes) : bytes_(std::move(bytes)) {
    PALPATE_CHECK(bytes_.size() >= kHeader && bytes_[1] == 1);
  }
  template <class T>
  T read() {
    at_ = kHeader + (at_ - kHeader + sizeof(T) - 1) / sizeof(T) * sizeof(T);
    PALPATE_CHECK(at_ + sizeof(T) <= bytes_.size());
    T value;
    std::memcpy(&value, &bytes_[at_], sizeof value);
    at_ += sizeof value;
    return value;
  }
  std::string text() {
    const auto size = read<std::uint32_t>();
    PALPATE_CHECK(size > 0 && at_ + size <= bytes_.size() && bytes_[at_ + size - 1] == 0);
    const std::string text(reinterpret_cast<const char*>(&bytes_[at_]), size - 1);
    at_ += size;
    return text;
  }
  template <std::size_t N>
  std::array<double, N> numbers() {
    std::array<double, N> numbers{};
    for (double& number : numbers) number = read<double>();
    return numbers;
  }
  std::int64_t time_ns() {
    const auto seconds = read<std::int32_t>();
    return seconds * std::int64_t{1'000'000'000} + read<std::uint32_t>();
  }

 private:
  static constexpr std::size_t kHeader = 4;
  Bytes bytes_;
  std::size_t at_ = kHeader;
};

/// A participant of Fast DDS, as a node of ROS 2 is.
class Node {
 public:
  /// @param address  numeric address of the only interface that is used. On loopback, which has no multicast,
  ///                 other participants are searched for at their ports, as with ROS_LOCALHOST_ONLY=1
  explicit Node(int domain, const std::string& address = kLoopback) {
    dds::DomainParticipantQos qos = dds::PARTICIPANT_QOS_DEFAULT;
    const auto transport = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    transport->interfaceWhiteList = {address};
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports = {transport};
    if (address == kLoopback) {
      eprosima::fastrtps::rtps::Locator_t peer;
      eprosima::fastrtps::rtps::IPLocator::setIPv4(peer, address);
      qos.wire_protocol().builtin.initialPeersList.push_back(peer);
    }
    participant_ = factory().create_participant(static_cast<dds::DomainId_t>(domain), qos);
    PALPATE_CHECK(participant_ != nullptr);
    subscriber_ = participant_->create_subscriber(dds::SUBSCRIBER_QOS_DEFAULT);
    publisher_ = participant_->create_publisher(dds::PUBLISHER_QOS_DEFAULT);
  }
  ~Node() {
    participant_->delete_contained_entities();
    factory().delete_participant(participant_);
  }
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;

  /// Subscribes as ROS 2 does: to poses with best effort, to all other topics with reliable delivery.
  /// @param late  whether messages sent before the subscription are requested
  dds::DataReader* subscribe(const std::string& name, const std::string& type, bool reliable,
                             bool late = false) {
    dds::DataReaderQos qos = dds::DATAREADER_QOS_DEFAULT;
    qos.reliability().kind = reliable ? dds::RELIABLE_RELIABILITY_QOS : dds::BEST_EFFORT_RELIABILITY_QOS;
    qos.durability().kind = late ? dds::TRANSIENT_LOCAL_DURABILITY_QOS : dds::VOLATILE_DURABILITY_QOS;
    return subscriber_->create_datareader(topic(name, type), qos);
  }
  dds::DataWriter* advertise(const std::string& name, const std::string& type, bool reliable) {
    dds::DataWriterQos qos = dds::DATAWRITER_QOS_DEFAULT;
    qos.reliability().kind = reliable ? dds::RELIABLE_RELIABILITY_QOS : dds::BEST_EFFORT_RELIABILITY_QOS;
    return publisher_->create_datawriter(topic(name, type), qos);
  }
  /// Next message of a reader; empty if none arrives within `patience`.
  static std::optional<Bytes> next(dds::DataReader* reader, std::chrono::nanoseconds patience = kPatience) {
    const auto until = std::chrono::steady_clock::now() + patience;
    while (true) {
      Bytes bytes;
      dds::SampleInfo info;
      if (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
        if (info.valid_data) return bytes;
        continue;
      }
      const std::chrono::duration<double> left = until - std::chrono::steady_clock::now();
      if (left.count() <= 0) return {};
      reader->wait_for_unread_message(eprosima::fastrtps::Duration_t(static_cast<long double>(left.count())));
    }
  }

 private:
  static constexpr const char* kLoopback = "127.0.0.1";

  static dds::DomainParticipantFactory& factory() { return *dds::DomainParticipantFactory::get_instance(); }
  dds::Topic* topic(const std::string& name, const std::string& type) {
    dds::TypeSupport(new RawType(type)).register_type(participant_);
    if (auto* known = dynamic_cast<dds::Topic*>(participant_->lookup_topicdescription(name))) return known;
    return participant_->create_topic(name, type, dds::TOPIC_QOS_DEFAULT);
  }

  dds::DomainParticipant* participant_ = nullptr;
  dds::Subscriber* subscriber_ = nullptr;
  dds::Publisher* publisher_ = nullptr;
};

/// Name by which ROS 2 announces a type.
inline std::string message_type(const std::string& package, const std::string& name) {
  return package + "::msg::dds_::" + name + "_";
}

}  // namespace palpate::fast_dds
