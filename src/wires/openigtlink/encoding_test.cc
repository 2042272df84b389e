#include "palpate/openigtlink/encoding.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <random>

#include "base/test_seed.h"
#include "palpate/openigtlink/messages.h"

namespace palpate::igtl {
namespace {

// openigtlink_server_test decodes each kind of message by a decoder of its own
TEST(Encoding, PosesAreDecodedAsTheyWereEncoded) {
  const auto seed = test::test_seed();
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> coordinate(-500, 500), turn(-1, 1);
  for (int n = 0; n < 100; ++n) {
    const Eigen::Quaterniond q =
        Eigen::Quaterniond(turn(random), turn(random), turn(random), turn(random)).normalized();
    const Eigen::Vector3d at(coordinate(random), coordinate(random), coordinate(random));
    const MessageBytes bytes = transform_message({"ProbeToRAS", 123456789}, q.toRotationMatrix(), at);
    PoseReader reader;
    int poses = 0;
    ASSERT_TRUE(reader.consume(bytes, [&](const PoseMessage& pose) {
      ++poses;
      EXPECT_EQ(pose.name, "ProbeToRAS");
      EXPECT_EQ(pose.stamp, 123456789u);
      EXPECT_TRUE(pose.is_tracked);
      EXPECT_LT((pose.at_mm - at).norm(), 1e-4);
      EXPECT_LT((pose.rotation - q.toRotationMatrix()).norm(), 1e-6) << "seed " << seed;
    }));
    EXPECT_EQ(poses, 1);
    EXPECT_EQ(reader.damaged(), 0u);
  }
}

TEST(Encoding, LongTextsAreCutBetweenCharacters) {
  // 19 letters and one of two bytes: the name's field has 20 bytes
  const std::string name = std::string(19, 'a') + "\xc3\xa4";
  const MessageBytes bytes = string_message({name}, std::string(70'000, 'x'));
  EXPECT_EQ(bytes[14 + 18], 'a');
  EXPECT_EQ(bytes[14 + 19], 0);
  EXPECT_EQ(bytes.size(), kHeader_bytes + 4 + 65'535);
}

}  // namespace
}  // namespace palpate::igtl
