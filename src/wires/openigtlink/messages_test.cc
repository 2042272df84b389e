#include "palpate/openigtlink/messages.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <numbers>
#include <random>

#include "base/test_seed.h"
#include "openigtlink/test_messages.h"
#include "palpate/openigtlink/encoding.h"

namespace palpate::igtl {
namespace {

using test::element_bytes;
using test::matrix_bytes;
using test::message_bytes;
using test::MessageBytes;
using test::MessageWords;
using test::quaternion_bytes;
using ::testing::HasSubstr;

Eigen::Isometry3d some_pose() {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  pose.translation() = Eigen::Vector3d(100.25, -50.5, 900.125);
  return pose;
}

struct Read {
  std::vector<PoseMessage> poses;
  std::uint64_t damaged = 0;
  std::string refused;
};
// @param piece  bytes at a time; 0: all at once
Read read(const MessageBytes& bytes, std::size_t piece = 0) {
  PoseReader reader;
  Read out;
  const std::size_t step = piece > 0 ? piece : std::max<std::size_t>(1, bytes.size());
  for (std::size_t from = 0; from < bytes.size() && out.refused.empty(); from += step) {
    const auto used = reader.consume(std::span(bytes).subspan(from, std::min(step, bytes.size() - from)),
                                     [&](const PoseMessage& message) { out.poses.push_back(message); });
    if (!used) out.refused = used.error().message();
  }
  out.damaged = reader.damaged();
  return out;
}
MessageBytes joined(const std::vector<MessageBytes>& parts) {
  MessageBytes all;
  for (const MessageBytes& part : parts) all.insert(all.end(), part.begin(), part.end());
  return all;
}

void expect_some_pose(const PoseMessage& message, const std::string& name) {
  EXPECT_EQ(message.name, name);
  EXPECT_TRUE(message.is_tracked);
  EXPECT_LT((message.rotation - some_pose().linear()).norm(), 1e-6);
  EXPECT_LT((message.at_mm - some_pose().translation()).norm(), 1e-4);
}

// ECMA 182; check value as in the protocol's examples
TEST(IgtlMessages, TheChecksumIsTheProtocols) {
  const std::string text = "123456789";
  const std::vector<std::uint8_t> bytes(text.begin(), text.end());
  EXPECT_EQ(crc64(bytes), 0x6C40DF5F0B497347u);
}

TEST(IgtlMessages, PosesOfEveryKindAndVersionInPiecesOfAnyLength) {
  const MessageWords words{{"TransformStatus", "OK"}}, of_each{{"StylusToTrackerStatus", "OK"}};
  const MessageBytes all = joined({
      test::transform_message("StylusToTracker", some_pose(), 77),
      message_bytes("STATUS", "PLUS", MessageBytes(31, 0), &words),
      message_bytes("TRANSFORM", "StylusToTracker", matrix_bytes(some_pose()), &words),
      message_bytes("POSITION", "StylusToTracker", quaternion_bytes(some_pose())),
      message_bytes("IMAGE", "Image", MessageBytes(100'000, 7)),
      message_bytes("TDATA", "all",
                    joined({element_bytes("StylusToTracker", matrix_bytes(some_pose())),
                            element_bytes("StylusToTracker", matrix_bytes(some_pose()))}),
                    &of_each),
      message_bytes("QTDATA", "all", element_bytes("StylusToTracker", quaternion_bytes(some_pose()))),
  });
  for (const std::size_t piece : {0u, 1u, 57u, 1000u}) {
    SCOPED_TRACE(piece);
    const Read observed = read(all, piece);
    EXPECT_EQ(observed.refused, "");
    EXPECT_EQ(observed.damaged, 0u);
    ASSERT_EQ(observed.poses.size(), 6u);
    for (const PoseMessage& pose : observed.poses) expect_some_pose(pose, "StylusToTracker");
    EXPECT_EQ(observed.poses[0].stamp, 77u);
  }
}

// messages packed by the reference library (libopenigtlink 1.11), with a rotation by 90 degrees about z and
// the time 1234.5 s
TEST(IgtlMessages, ReadsMessagesOfTheReferenceLibrary) {
  const std::pair<const char*, std::string> packed[] = {
      {"transform",
       "00015452414e53464f524d0000005374796c7573546f547261636b65720000000000000004d27fffffff0000"
       "0000000000300af905ad2d656923000000003f80000000000000bf8000000000000000000000000000000000"
       "00003f80000042c88000c24a000044610800"},
      {"position",
       "0001504f534954494f4e000000005374796c7573546f547261636b6572000000000000000000000000000000"
       "00000000001c54120a6938d64f6a42c88000c24a00004461080000000000000000003f3504f33f3504f3"},
      {"tdata",
       "0001544441544100000000000000616c6c000000000000000000000000000000000000000000000000000000"
       "000000000046f0d4c1e1ebd26f895374796c7573546f547261636b657200000000000200000000003f800000"
       "00000000bf800000000000000000000000000000000000003f80000042c88000c24a000044610800"},
      {"qtdata",
       "0001515444415441000000000000616c6c000000000000000000000000000000000000000000000000000000"
       "000000000032ae11b9a3aad756175374796c7573546f547261636b65720000000000020042c88000c24a0000"
       "4461080000000000000000003f3504f33f3504f3"}};
  Eigen::Matrix3d turn;
  turn << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  for (const auto& [kind, digits] : packed) {
    SCOPED_TRACE(kind);
    MessageBytes bytes;
    for (std::size_t n = 0; n < digits.size(); n += 2)
      bytes.push_back(static_cast<std::uint8_t>(std::stoi(digits.substr(n, 2), nullptr, 16)));
    const Read observed = read(bytes);
    EXPECT_EQ(observed.damaged, 0u);
    ASSERT_EQ(observed.poses.size(), 1u);
    EXPECT_EQ(observed.poses[0].name, "StylusToTracker");
    EXPECT_TRUE(observed.poses[0].is_tracked);
    EXPECT_LT((observed.poses[0].rotation - turn).norm(), 1e-6);
    EXPECT_EQ(observed.poses[0].at_mm, Eigen::Vector3d(100.25, -50.5, 900.125));
    EXPECT_NEAR(static_cast<double>(observed.poses[0].stamp) / 4294967296.0,
                kind == std::string("transform") ? 1234.5 : 0, 1e-6);
  }
}

// PLUS reports it in the metadata, and before version 2 of the protocol by the identity
TEST(IgtlMessages, InvisibleToolHasNoPose) {
  const auto observed = [](const MessageBytes& bytes) {
    const Read received = read(bytes);
    EXPECT_EQ(received.poses.size(), 1u);
    return !received.poses.empty() && received.poses[0].is_tracked;
  };
  const MessageBytes fine = matrix_bytes(some_pose());
  for (const auto& [status, is_visible] :
       {std::pair("OK", true), {"OUT_OF_VIEW", false}, {"MISSING", false}}) {
    const MessageWords words{{"TransformValid", "x"}, {"TransformStatus", status}},
        of_each{{"ToolStatus", status}};
    EXPECT_EQ(observed(message_bytes("TRANSFORM", "Tool", fine, &words)), is_visible) << status;
    EXPECT_EQ(observed(message_bytes("POSITION", "Tool", quaternion_bytes(some_pose()), &words)), is_visible)
        << status;
    EXPECT_EQ(observed(message_bytes("TDATA", "all", element_bytes("Tool", fine), &of_each)), is_visible)
        << status;
  }
  EXPECT_FALSE(observed(test::transform_message("Tool", Eigen::Isometry3d::Identity())));
  Eigen::Isometry3d odd = some_pose();
  odd.linear() *= 1.1;
  EXPECT_FALSE(observed(test::transform_message("Tool", odd)));
  odd = some_pose();
  odd.linear().col(0) *= -1;
  EXPECT_FALSE(observed(test::transform_message("Tool", odd)));
  odd = some_pose();
  odd.translation().x() = std::nan("");
  EXPECT_FALSE(observed(test::transform_message("Tool", odd)));
  EXPECT_FALSE(observed(message_bytes("POSITION", "Tool", MessageBytes(28, 0))));
}

// names that exceed the message's field are in the metadata
TEST(IgtlMessages, KeepsLongNames) {
  const std::string name = "AVeryLongInstrumentToTracker", shorter = name.substr(0, 20);
  const MessageWords words{{"IGTL_DEVICE_NAME", name}, {"TransformStatus", "OK"}},
      of_each{{name + "Status", "OK"}};
  const Read observed =
      read(joined({message_bytes("TRANSFORM", shorter, matrix_bytes(some_pose()), &words),
                   message_bytes("TDATA", "all", element_bytes(shorter, matrix_bytes(some_pose())), &of_each),
                   test::transform_message(shorter, some_pose())}));
  ASSERT_EQ(observed.poses.size(), 3u);
  expect_some_pose(observed.poses[0], name);
  expect_some_pose(observed.poses[1], name);
  expect_some_pose(observed.poses[2], shorter);
}

TEST(IgtlMessages, SkipsDamagedMessagesAndEndsOnForeignData) {
  MessageBytes wrong = test::transform_message("Tool", some_pose());
  wrong.back() ^= 1;
  const MessageBytes fine = test::transform_message("Tool", some_pose());
  const Read observed = read(joined({wrong, fine, message_bytes("TRANSFORM", "Tool", MessageBytes(47, 0)),
                                     message_bytes("TDATA", "Tool", MessageBytes(71, 0)), fine}));
  EXPECT_EQ(observed.damaged, 3u);
  EXPECT_EQ(observed.poses.size(), 2u);
  // inconsistent lengths
  MessageBytes body;
  test::append_integer(body, 2, 12);
  test::append_integer(body, 2, 60'000);
  test::append_integer(body, 8, ~std::uint64_t{0});
  const MessageWords none;
  MessageBytes lying = message_bytes("TRANSFORM", "Tool", {}, &none);
  lying.resize(kHeader_bytes);
  lying.insert(lying.end(), body.begin(), body.end());
  lying[49] = 12;
  const std::uint64_t crc = crc64(body);
  for (std::size_t n = 0; n < 8; ++n) lying[50 + n] = static_cast<std::uint8_t>(crc >> (56 - 8 * n));
  EXPECT_EQ(read(lying).damaged, 1u);

  const std::string page = "HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: 100000\r\n\r\n";
  EXPECT_THAT(read(MessageBytes(page.begin(), page.end())).refused, HasSubstr("does not send OpenIGTLink"));
  MessageBytes endless = fine;
  for (std::size_t n = 0; n < 8; ++n) endless[42 + n] = 0xff;
  EXPECT_THAT(read(endless).refused, HasSubstr("does not send OpenIGTLink"));
}

// otherwise the following poses would be taken for its body
TEST(IgtlMessages, AWrongLengthEndsItAtOnce) {
  const MessageBytes pose = test::transform_message("Tool", some_pose());
  const auto head_of = [](MessageBytes bytes, std::uint64_t length) {
    bytes.resize(kHeader_bytes);
    for (std::size_t n = 0; n < 8; ++n) bytes[42 + n] = static_cast<std::uint8_t>(length >> (56 - 8 * n));
    return bytes;
  };
  // any single bit that makes it longer than a pose
  for (int bit = 17; bit < 64; ++bit)
    EXPECT_THAT(read(head_of(pose, 48 | std::uint64_t{1} << bit)).refused,
                HasSubstr("does not send OpenIGTLink"))
        << bit;
  const MessageBytes image = message_bytes("IMAGE", "Image", {}),
                     status = message_bytes("STATUS", "PLUS", {});
  EXPECT_EQ(read(head_of(image, std::uint64_t{1} << 28)).refused, "");
  EXPECT_THAT(read(head_of(image, std::uint64_t{1} << 33)).refused, HasSubstr("does not send OpenIGTLink"));
  EXPECT_EQ(read(head_of(status, std::uint64_t{1} << 24)).refused, "");
  EXPECT_THAT(read(head_of(status, std::uint64_t{1} << 30)).refused, HasSubstr("does not send OpenIGTLink"));
}

TEST(IgtlMessages, PoseOutsideTheTrackingRangeIsInvisible) {
  for (const double mm : {9'000.0, 11'000.0, 1e30, std::numeric_limits<double>::infinity(), std::nan("")}) {
    Eigen::Isometry3d pose = some_pose();
    pose.translation() = Eigen::Vector3d(0, mm, 0);
    const Read observed = read(test::transform_message("Tool", pose));
    ASSERT_EQ(observed.poses.size(), 1u);
    EXPECT_EQ(observed.poses[0].is_tracked, mm < 10'000) << mm;
  }
}

// a STATUS of version 2 with code OK
TEST(IgtlMessages, GreetingIsACompleteMessage) {
  const auto bytes = greeting();
  ASSERT_EQ(bytes.size(), kHeader_bytes + 12 + 31 + 2);
  EXPECT_EQ(bytes[1], 2);
  EXPECT_EQ(bytes[49], 45);
  EXPECT_EQ(read(bytes).refused, "");
  const std::uint64_t crc = crc64(std::span(bytes).subspan(kHeader_bytes));
  for (std::size_t n = 0; n < 8; ++n)
    EXPECT_EQ(bytes[50 + n], static_cast<std::uint8_t>(crc >> (56 - 8 * n)));
}

// Seed corpus of messages_fuzzer. PALPATE_WRITE_SEEDS=src/wires/openigtlink/messages_fuzzer_corpus
// regenerates it.
TEST(IgtlSeeds, AreUnderstood) {
  const MessageWords words{{"TransformStatus", "OK"}}, of_each{{"StylusToTrackerStatus", "MISSING"}};
  const std::pair<const char*, MessageBytes> seeds[] = {
      {"transform", test::transform_message("StylusToTracker", some_pose(), 77)},
      {"transform_2", message_bytes("TRANSFORM", "StylusToTracker", matrix_bytes(some_pose()), &words)},
      {"position", message_bytes("POSITION", "StylusToTracker", quaternion_bytes(some_pose()))},
      {"tdata_2",
       message_bytes("TDATA", "all", element_bytes("StylusToTracker", matrix_bytes(some_pose())), &of_each)},
      {"qtdata",
       message_bytes("QTDATA", "all", element_bytes("StylusToTracker", quaternion_bytes(some_pose())))}};
  if (const char* target = std::getenv("PALPATE_WRITE_SEEDS"))
    for (const auto& [name, bytes] : seeds)
      std::ofstream(std::filesystem::path(target) / name, std::ios::binary)
          .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  for (const auto& [name, bytes] : seeds) {
    std::ifstream in(
        std::filesystem::path(PALPATE_SOURCE_DIR) / "src/wires/openigtlink/messages_fuzzer_corpus" / name,
        std::ios::binary);
    const MessageBytes stored{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
    EXPECT_EQ(read(stored).poses.size(), 1u) << name;
    EXPECT_EQ(stored, bytes) << name;
  }
}

}  // namespace
}  // namespace palpate::igtl
