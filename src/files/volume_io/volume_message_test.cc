#include "volume_io/volume_message.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <vector>

namespace palpate::volume_io {
namespace {

using testing::HasSubstr;

const std::vector<std::filesystem::path> kFiles{"/a/named.nhdr", "/a/voxels.raw"};

class Memory : public reader::ByteTarget, public reader::ByteSource {
 public:
  bool write(std::span<const std::byte> more) override {
    bytes.insert(bytes.end(), more.begin(), more.end());
    return true;
  }
  Result<void> read(std::span<std::byte> requested) override {
    if (requested.size() > bytes.size() - at) return Error{ErrorKind::kBadInput, "ended", "", ""};
    std::memcpy(requested.data(), bytes.data() + at, requested.size());
    at += requested.size();
    return {};
  }
  std::vector<std::byte> bytes;
  std::size_t at = 0;
};

// volume without a member at its default value
VolumeFile example() {
  VolumeFile volume;
  volume.header.geometry.dims = {5, 6, 7};
  volume.header.geometry.spacing_mm = {0.5, 1.5, 2.5};
  volume.header.geometry.origin = Point<Patient>(Eigen::Vector3d(1, -2, 3));
  volume.header.geometry.direction << 0, 1, 0, 0, 0, 1, 1, 0, 0;
  volume.header.layers = 3;
  volume.header.has_geometry = false;
  volume.header.meaning = ValueMeaning::kLabels;
  volume.voxels = {kFiles[1], Encoding::kBzip2, Component::kUint64, true, 11, 12, 13, true, 2.5, -7};
  volume.layers_first = false;
  volume.segment_fields = {{"Segment0_Name", "femur"}, {"Segment0_ID", ""}};
  volume.padded = true;
  volume.notes = {"left out: 1 file", ""};
  return volume;
}

std::string error_of(const std::function<void(VolumeFile&)>& change) {
  VolumeFile volume = example();
  change(volume);
  Memory memory;
  EXPECT_TRUE(send_volume(memory, volume, kFiles));
  const auto answer = receive_answer(memory, kFiles);
  if (answer) return "no error";
  EXPECT_EQ(answer.error().where, kFiles[0].string());
  return answer.error().what;
}

TEST(VolumeMessage, AVolumeArrivesWhole) {
  Memory memory;
  const VolumeFile sent = example();
  ASSERT_TRUE(send_volume(memory, sent, kFiles));
  const auto answer = receive_answer(memory, kFiles);
  ASSERT_TRUE(answer) << answer.error().message();
  const auto& received = std::get<VolumeFile>(*answer);
  EXPECT_EQ(memory.at, memory.bytes.size());
  EXPECT_EQ(received.header.geometry.dims, sent.header.geometry.dims);
  EXPECT_EQ(received.header.geometry.spacing_mm, sent.header.geometry.spacing_mm);
  EXPECT_EQ(received.header.geometry.direction, sent.header.geometry.direction);
  for (int a = 0; a < 3; ++a) EXPECT_EQ(received.header.geometry.origin[a], sent.header.geometry.origin[a]);
  EXPECT_EQ(received.header.layers, 3);
  EXPECT_FALSE(received.header.has_geometry);
  EXPECT_TRUE(received.header.has_segments);
  EXPECT_EQ(received.header.meaning, ValueMeaning::kLabels);
  EXPECT_EQ(received.voxels.file, kFiles[1]);
  EXPECT_EQ(received.voxels.encoding, Encoding::kBzip2);
  EXPECT_EQ(received.voxels.component, Component::kUint64);
  EXPECT_TRUE(received.voxels.big_endian);
  EXPECT_EQ(received.voxels.offset, 11u);
  EXPECT_EQ(received.voxels.skip, 12u);
  EXPECT_EQ(received.voxels.trailing_bytes, 13u);
  EXPECT_TRUE(received.voxels.may_have_more);
  EXPECT_EQ(received.voxels.slope, 2.5);
  EXPECT_EQ(received.voxels.intercept, -7);
  EXPECT_FALSE(received.layers_first);
  EXPECT_EQ(received.segment_fields, sent.segment_fields);
  EXPECT_TRUE(received.padded);
  EXPECT_EQ(received.notes, sent.notes);
}

TEST(VolumeMessage, RejectsInvalidVolumes) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(error_of([](VolumeFile&) {}), "no error");
  for (const int size : {0, -1})
    EXPECT_THAT(error_of([&](VolumeFile& v) { v.header.geometry.dims[1] = size; }), HasSubstr("axis 2"));
  EXPECT_THAT(error_of([](VolumeFile& v) {
                v.header.geometry.dims = {1 << 30, 1 << 30, 1 << 30};
              }),
              HasSubstr("more voxels than any scan"));
  EXPECT_THAT(error_of([](VolumeFile& v) { v.header.geometry.spacing_mm[2] = 0; }), HasSubstr("spacing"));
  EXPECT_THAT(error_of([&](VolumeFile& v) { v.header.geometry.direction(1, 1) = kNan; }),
              HasSubstr("a non-finite value"));
  EXPECT_THAT(error_of([](VolumeFile& v) { v.header.geometry.direction.setZero(); }),
              HasSubstr("in one plane"));
  for (const int layers : {0, -3, 4097})
    EXPECT_THAT(error_of([&](VolumeFile& v) { v.header.layers = layers; }),
                HasSubstr("an impossible volume"));
  EXPECT_THAT(error_of([&](VolumeFile& v) { v.voxels.slope = kNan; }), HasSubstr("an impossible volume"));
  EXPECT_THAT(error_of([&](VolumeFile& v) { v.voxels.intercept = kNan; }), HasSubstr("an impossible volume"));
  // invalid enumerators, and a file to which the process has no access
  EXPECT_THAT(error_of([](VolumeFile& v) { v.voxels.encoding = static_cast<Encoding>(6); }),
              HasSubstr("an impossible volume"));
  EXPECT_THAT(error_of([](VolumeFile& v) { v.voxels.component = static_cast<Component>(10); }),
              HasSubstr("an impossible volume"));
  EXPECT_THAT(error_of([](VolumeFile& v) { v.header.meaning = static_cast<ValueMeaning>(3); }),
              HasSubstr("an impossible volume"));
  EXPECT_THAT(error_of([](VolumeFile& v) { v.voxels.file = "/etc/passwd"; }),
              HasSubstr("an impossible volume"));
  EXPECT_THAT(error_of([](VolumeFile& v) {
                v.segment_fields.assign(3, {std::string(9'000'000, 'x'), ""});
              }),
              HasSubstr("too long"));
  EXPECT_THAT(error_of([](VolumeFile& v) { v.notes.resize(101); }), HasSubstr("an impossible volume"));
}

TEST(VolumeMessage, EndsAreNoticedAtEveryByte) {
  for (const auto& send : std::vector<std::function<bool(Memory&)>>{
           [](Memory& m) { return send_volume(m, example(), kFiles); },
           [](Memory& m) { return send_refusal(m, bad_input("/a/named.nhdr", "is bad", "mend it")); },
           [](Memory& m) {
             return send_file_request(m, {OtherFile::Which::kNamed, "x"});
           }}) {
    Memory whole;
    ASSERT_TRUE(send(whole));
    for (std::size_t size = 0; size < whole.bytes.size(); ++size) {
      Memory part;
      part.bytes.assign(whole.bytes.begin(), whole.bytes.begin() + static_cast<std::ptrdiff_t>(size));
      const auto answer = receive_answer(part, kFiles);
      ASSERT_FALSE(answer) << size;
      EXPECT_EQ(answer.error().what, "ended");
      EXPECT_EQ(answer.error().where, kFiles[0].string());
    }
  }
}

TEST(VolumeMessage, PromisesOfFieldsTakeNoMemory) {
  Memory memory;
  VolumeFile volume = example();
  volume.segment_fields.clear();
  ASSERT_TRUE(send_volume(memory, volume, kFiles));
  // the number of fields, which comes last
  const std::uint32_t many = 1 << 20;
  std::memcpy(memory.bytes.data() + memory.bytes.size() - sizeof many, &many, sizeof many);
  EXPECT_EQ(receive_answer(memory, kFiles).error().what, "ended");
  memory.at = 0;
  const std::uint32_t more = many + 1;
  std::memcpy(memory.bytes.data() + memory.bytes.size() - sizeof more, &more, sizeof more);
  EXPECT_THAT(receive_answer(memory, kFiles).error().what, HasSubstr("an impossible volume"));
}

TEST(VolumeMessage, RefusalsAreAboutItsFiles) {
  const auto refused = [](const Error& refusal) {
    Memory memory;
    EXPECT_TRUE(send_refusal(memory, refusal));
    return receive_answer(memory, kFiles).error();
  };
  const Error same = refused(bad_input("/a/voxels.raw:3", "is bad", "mend it"));
  EXPECT_EQ(same.where, "/a/voxels.raw:3");
  EXPECT_EQ(same.what, "is bad");
  EXPECT_EQ(same.remedy, "mend it");
  EXPECT_EQ(refused(bad_input("/etc/passwd", "is bad")).where, kFiles[0].string());
  EXPECT_EQ(refused({ErrorKind::kUnavailable, "", "", ""}).what, "is damaged: its reader gives no reason");
  EXPECT_EQ(refused({ErrorKind::kUnavailable, "x", "", ""}).kind, ErrorKind::kBadInput);
  EXPECT_EQ(refused(bad_input("/a/voxels.raw", std::string(100'000, 'x'))).what.size(), 65536u);
}

TEST(VolumeMessage, EndsAndWishesArrive) {
  Memory memory;
  ASSERT_TRUE(send_end(memory, {}));
  ASSERT_TRUE(send_end(memory, bad_input("/a/voxels.raw", "ends early")));
  for (const bool whole : {true, false}) {
    std::uint32_t end = 0;
    ASSERT_TRUE(memory.read(std::as_writable_bytes(std::span(&end, 1))));
    EXPECT_EQ(end, kEnd);
    const auto reported = receive_end(memory, kFiles);
    EXPECT_EQ(reported.ok(), whole);
    if (!reported) {
      EXPECT_EQ(reported.error().message(), "/a/voxels.raw: ends early");
    }
  }
  const OtherFile requested{OtherFile::Which::kVoxels, "name"};
  ASSERT_TRUE(send_file_request(memory, requested));
  const auto answer = receive_answer(memory, kFiles);
  ASSERT_TRUE(answer);
  EXPECT_EQ(std::get<OtherFile>(*answer), requested);
  ASSERT_TRUE(send_file_request(memory, {static_cast<OtherFile::Which>(3), ""}));
  EXPECT_FALSE(receive_answer(memory, kFiles));
}

}  // namespace
}  // namespace palpate::volume_io
