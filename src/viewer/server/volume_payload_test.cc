#include "server/volume_payload.h"

#include <gtest/gtest.h>
#include <zlib.h>

#include <cmath>
#include <future>
#include <limits>
#include <map>
#include <new>
#include <random>
#include <stdexcept>
#include <thread>

#include "base/test_seed.h"
#include "server/payload_store.h"
#include "server/test_client.h"

namespace palpate::server {
namespace {

using palpate::testing::number_at;

const std::atomic<bool> kResume{false}, kStop{true};

GridGeometry grid_of(std::array<int, 3> dims) {
  GridGeometry grid;
  grid.dims = dims;
  return grid;
}

Volume<float> scan_of(std::vector<float> values) {
  const auto dims = std::array<int, 3>{static_cast<int>(values.size()), 1, 1};
  return Volume<float>(grid_of(dims), std::move(values));
}

std::string gunzip(const std::string& packed, std::size_t size) {
  std::string plain(size + 1, '\0');
  z_stream stream{};
  inflateInit2(&stream, 15 + 16);
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data()));
  stream.avail_in = static_cast<uInt>(packed.size());
  stream.next_out = reinterpret_cast<Bytef*>(plain.data());
  stream.avail_out = static_cast<uInt>(plain.size());
  EXPECT_EQ(inflate(&stream, Z_FINISH), Z_STREAM_END);
  plain.erase(plain.size() - stream.avail_out);
  inflateEnd(&stream);
  return plain;
}

TEST(VolumePayload, WholeNumbersOfSixteenBitsAreExact) {
  for (const auto& values :
       {std::vector<float>{-1024, 0, 3071}, std::vector<float>{-32768, 32767}, std::vector<float>{0, 65535},
        std::vector<float>{100000, 165535}, std::vector<float>{7, 7}}) {
    const Volume<float> scan = scan_of(values);
    const ScanScale scale = ScanScale::of(scan);
    EXPECT_EQ(scale.scale, 1);
    const auto bytes = scan_payload(scan, scale, 1, kResume);
    ASSERT_EQ(bytes->size(), 2 * values.size());
    for (std::size_t v = 0; v < values.size(); ++v)
      EXPECT_EQ(scale.offset + scale.scale * number_at<std::int16_t>(*bytes, 2 * v), values[v]);
  }
  EXPECT_EQ(ScanScale::of(scan_of({-1024, 3071})).offset, 0);
}

TEST(VolumePayload, OtherNumbersAreWithinHalfAStep) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE(seed);
  std::mt19937 random(seed);
  for (const float width : {1e-6f, 1.0f, 1e9f}) {
    std::vector<float> values(1000);
    for (float& value : values) value = width * (std::generate_canonical<float, 24>(random) - 0.3f);
    const Volume<float> scan = scan_of(values);
    const ScanScale scale = ScanScale::of(scan);
    const auto bytes = scan_payload(scan, scale, 1, kResume);
    const double step = (scale.range[1] - scale.range[0]) / 65535;
    for (std::size_t v = 0; v < values.size(); ++v)
      EXPECT_NEAR(scale.offset + scale.scale * number_at<std::int16_t>(*bytes, 2 * v), values[v],
                  0.5001 * step);
  }
}

TEST(VolumePayload, NaNBecomesTheLowestValue) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN(),
                  kInf = std::numeric_limits<float>::infinity();
  const Volume<float> scan = scan_of({kNan, -kInf, kInf, -5, 9});
  const ScanScale scale = ScanScale::of(scan);
  EXPECT_EQ(scale.range, (std::array<double, 2>{-5, 9}));
  const auto bytes = scan_payload(scan, scale, 1, kResume);
  EXPECT_EQ(number_at<std::int16_t>(*bytes, 0), -5);
  EXPECT_EQ(number_at<std::int16_t>(*bytes, 2), -5);
  EXPECT_EQ(number_at<std::int16_t>(*bytes, 4), 9);

  const Volume<float> none = scan_of({kNan, kNan});
  EXPECT_EQ(ScanScale::of(none).range, (std::array<double, 2>{0, 0}));
  EXPECT_EQ(number_at<std::int16_t>(*scan_payload(none, ScanScale::of(none), 1, kResume), 0), 0);
}

// the maximum range of floats, and a constant that is not an integer
TEST(VolumePayload, ExtremeRangesStayFinite) {
  const float largest = std::numeric_limits<float>::max();
  for (const auto& values : {std::vector<float>{-largest, 0, largest}, std::vector<float>{0.1f, 0.1f}}) {
    const Volume<float> scan = scan_of(values);
    const ScanScale scale = ScanScale::of(scan);
    EXPECT_TRUE(std::isfinite(scale.scale) && scale.scale > 0 && std::isfinite(scale.offset));
    const auto bytes = scan_payload(scan, scale, 1, kResume);
    for (std::size_t v = 0; v < values.size(); ++v)
      EXPECT_NEAR(scale.offset + scale.scale * number_at<std::int16_t>(*bytes, 2 * v), values[v],
                  scale.scale);
  }
}

TEST(VolumePayload, ShrunkScanIsTheMeanOfExistingVoxels) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE(seed);
  std::mt19937 random(seed);
  Volume<float> scan(grid_of({5, 7, 6}));
  for (float& voxel : scan.voxels())
    voxel = random() % 9 == 0 ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(random() % 1000);
  const ScanScale scale = ScanScale::of(scan);
  for (const int shrink : {2, 4}) {
    const auto dims = shrunk_dims({5, 7, 6}, shrink);
    EXPECT_EQ(dims[0], (5 + shrink - 1) / shrink);
    // each voxel adds itself to its block
    std::map<std::array<int, 3>, std::pair<double, int>> blocks;
    for (int k = 0; k < 6; ++k)
      for (int j = 0; j < 7; ++j)
        for (int i = 0; i < 5; ++i) {
          if (!std::isfinite(scan.at(i, j, k))) continue;
          auto& [sum, count] = blocks[{i / shrink, j / shrink, k / shrink}];
          sum += scan.at(i, j, k);
          ++count;
        }
    const auto bytes = scan_payload(scan, scale, shrink, kResume);
    ASSERT_EQ(bytes->size(), 2u * dims[0] * dims[1] * dims[2]);
    std::size_t at = 0;
    for (int k = 0; k < dims[2]; ++k)
      for (int j = 0; j < dims[1]; ++j)
        for (int i = 0; i < dims[0]; ++i, at += 2) {
          const auto& [sum, count] = blocks[{i, j, k}];
          const double mean = count > 0 ? sum / count : scale.range[0];
          EXPECT_NEAR(number_at<std::int16_t>(*bytes, at), mean, 0.5001) << i << " " << j << " " << k;
        }
  }
}

TEST(VolumePayload, LabelsOfOneAndTwoBytes) {
  Volume<LabelId> labels(grid_of({3, 1, 1}), std::vector<LabelId>{0, 255, 7});
  EXPECT_FALSE(needs_wide_labels(*label_bricks(labels)));
  EXPECT_EQ(*labels_payload(*label_bricks(labels), false, 1, kResume), std::string("\x00\xff\x07", 3));
  labels.at(1, 0, 0) = 0x1234;
  EXPECT_TRUE(needs_wide_labels(*label_bricks(labels)));
  EXPECT_EQ(*labels_payload(*label_bricks(labels), true, 1, kResume),
            std::string("\x00\x00\x34\x12\x07\x00", 6));
}

TEST(VolumePayload, ShrunkLabelsAreTheMostFrequent) {
  const auto of = [](std::vector<LabelId> block) {
    const Volume<LabelId> labels(grid_of({2, 2, 2}), std::move(block));
    return static_cast<int>(labels_payload(*label_bricks(labels), false, 2, kResume)->at(0));
  };
  EXPECT_EQ(of({0, 0, 0, 0, 0, 0, 0, 0}), 0);
  EXPECT_EQ(of({9, 9, 9, 9, 9, 9, 9, 9}), 9);
  EXPECT_EQ(of({0, 0, 0, 0, 0, 3, 3, 3}), 0);
  EXPECT_EQ(of({5, 5, 5, 2, 2, 2, 2, 0}), 2);
  // in a tie the lowest above 0
  EXPECT_EQ(of({0, 0, 0, 0, 3, 3, 3, 3}), 3);
  EXPECT_EQ(of({8, 3, 8, 3, 0, 0, 1, 1}), 1);
  EXPECT_EQ(of({8, 8, 8, 3, 3, 3, 0, 0}), 3);
}

TEST(VolumePayload, ShrunkLabelsAgreeWithCounting) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE(seed);
  std::mt19937 random(seed);
  Volume<LabelId> labels(grid_of({9, 6, 5}));
  for (LabelId& label : labels.voxels()) label = static_cast<LabelId>(random() % 4 * 300);
  for (const int shrink : {2, 4}) {
    const auto dims = shrunk_dims({9, 6, 5}, shrink);
    const auto bytes = labels_payload(*label_bricks(labels), true, shrink, kResume);
    std::size_t at = 0;
    for (int k = 0; k < dims[2]; ++k)
      for (int j = 0; j < dims[1]; ++j)
        for (int i = 0; i < dims[0]; ++i, at += 2) {
          std::map<LabelId, int> counts;
          for (int z = k * shrink; z < std::min(5, (k + 1) * shrink); ++z)
            for (int y = j * shrink; y < std::min(6, (j + 1) * shrink); ++y)
              for (int x = i * shrink; x < std::min(9, (i + 1) * shrink); ++x) ++counts[labels.at(x, y, z)];
          const auto found = number_at<std::uint16_t>(*bytes, at);
          for (const auto& [label, count] : counts) {
            EXPECT_LE(count, counts[found]);
            EXPECT_TRUE(count < counts[found] || label == 0 || (found > 0 && found <= label));
          }
        }
  }
}

TEST(VolumePayload, GzipGivesTheSameBack) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE(seed);
  std::mt19937 random(seed);
  for (const std::size_t size :
       {std::size_t{0}, std::size_t{1}, std::size_t{1} << 20, std::size_t{5'000'001}}) {
    std::string bytes(size, '\0');
    for (std::size_t i = 0; i < size; i += 1 + random() % 7) bytes[i] = static_cast<char>(random());
    EXPECT_EQ(gunzip(*gzip(bytes, kResume), size), bytes);
  }
}

TEST(VolumePayload, StopsWhenAsked) {
  EXPECT_EQ(scan_payload(scan_of({1, 2}), {}, 1, kStop), nullptr);
  EXPECT_EQ(labels_payload(*label_bricks(Volume<LabelId>(grid_of({2, 1, 1}))), false, 2, kStop), nullptr);
  EXPECT_EQ(gzip("text", kStop), nullptr);
}

TEST(PayloadStore, MakesEachOnceAndElsewhere) {
  const auto scan = std::make_shared<Volume<float>>(scan_of({1, 2, 3}));
  const auto labels = label_bricks(Volume<LabelId>(grid_of({3, 1, 1}), LabelId{4}));
  PayloadStore store(volume_generator(scan, ScanScale::of(*scan), labels, false));
  std::mutex mutex;
  std::vector<PayloadStore::Payload> received;
  std::atomic<bool> elsewhere{true};
  const auto caller = std::this_thread::get_id();
  const auto visit = [&](PayloadStore::Payload payload) {
    const std::lock_guard lock(mutex);
    received.push_back(std::move(payload));
    if (std::this_thread::get_id() == caller) elsewhere = false;
  };
  store.request({false, 1, false}, visit);
  store.request({true, 1, false}, visit);
  store.request({true, 1, true}, visit);
  store.request({false, 1, false}, visit);
  ASSERT_TRUE(palpate::testing::soon([&] {
    const std::lock_guard lock(mutex);
    return received.size() == 4;
  }));
  EXPECT_TRUE(elsewhere);
  EXPECT_EQ(received[0]->size(), 6u);
  EXPECT_EQ(*received[1], "\4\4\4");
  EXPECT_EQ(gunzip(*received[2], 3), "\4\4\4");
  EXPECT_EQ(received[3].get(), received[0].get());
}

TEST(PayloadStore, EndsWithWishesOpen) {
  const auto labels = label_bricks(Volume<LabelId>(grid_of({256, 256, 128}), LabelId{4}));
  std::atomic<int> reported{0};
  {
    const auto make = volume_generator(nullptr, {}, labels, true);
    PayloadStore store([&](const PayloadKey& key, const std::atomic<bool>& stop) {
      // cannot finish before the store is destroyed
      while (!stop) std::this_thread::yield();
      return make(key, stop);
    });
    for (const int shrink : {1, 2, 4}) store.request({true, shrink, true}, [&](const auto&) { ++reported; });
  }
  EXPECT_EQ(reported, 0);
}

PayloadStore::Payload wait_for(PayloadStore& store) {
  std::promise<PayloadStore::Payload> promise;
  store.request({}, [&](PayloadStore::Payload payload) { promise.set_value(std::move(payload)); });
  return promise.get_future().get();
}

TEST(PayloadStore, GenerationFailureAffectsNoOtherRequest) {
  int fails = 2;
  PayloadStore store([&](const PayloadKey&, const std::atomic<bool>&) -> PayloadStore::Payload {
    if (fails == 2) throw(--fails, std::bad_alloc());
    if (fails == 1) throw(--fails, std::length_error("longer than any text"));
    return std::make_shared<const std::string>("scan");
  });
  EXPECT_EQ(wait_for(store), nullptr);
  EXPECT_EQ(wait_for(store), nullptr);
  EXPECT_EQ(*wait_for(store), "scan");
}

TEST(PayloadStore, ThrowingCallbackAffectsNoOtherRequest) {
  PayloadStore store(
      [](const PayloadKey&, const auto&) { return std::make_shared<const std::string>("scan"); });
  store.request({}, [](const auto&) { throw std::bad_alloc(); });
  EXPECT_EQ(*wait_for(store), "scan");
}

}  // namespace
}  // namespace palpate::server
