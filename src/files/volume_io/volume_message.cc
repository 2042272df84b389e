#include "volume_io/volume_message.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "volume_io/formats/headers.h"

namespace palpate::volume_io {
namespace {

using reader::Receiver;
using reader::Sender;

enum class Answer : std::uint8_t { kRefusal, kVolume, kFileRequest };

// maximum length of an error's texts and of a file name; longer ones are truncated
constexpr std::size_t kMaxErrorText = std::size_t{1} << 16;
// maximum number of segment fields
constexpr std::size_t kMaxFields = std::size_t{1} << 20;
constexpr int kMaxLayers = 4096;
constexpr std::uint32_t kMaxNotes = 100;

void put(Sender& out, const Error& refusal) {
  for (const std::string* text : {&refusal.what, &refusal.where, &refusal.remedy})
    out.put(text->substr(0, kMaxErrorText));
}

template <class Kind>
void get_one_of(Receiver& in, Kind& kind, Kind last) {
  std::uint8_t number = 0;
  in.get(number);
  if (number > static_cast<std::uint8_t>(last)) in.fail("its reader reports an impossible volume");
  if (in.ok()) kind = static_cast<Kind>(number);
}

Receiver receiver(reader::ByteSource& source) {
  return Receiver(source, "is damaged: ");
}

Error get_refusal(Receiver& in, Files files) {
  Error refusal{ErrorKind::kBadInput, "", "", ""};
  for (std::string* text : {&refusal.what, &refusal.where, &refusal.remedy}) in.get(*text, kMaxErrorText);
  if (refusal.what.empty()) in.fail("its reader gives no reason");
  if (!in.ok()) return about(in.error(), files);
  // only the files of this process may be named
  const auto names = [&](const std::filesystem::path& file) {
    return refusal.where.starts_with(file.string());
  };
  if (std::ranges::none_of(files, names)) refusal.where = files.front().string();
  return refusal;
}

// fields serialised in the same order at both ends; `field` sends or receives one
template <class Geometry, class Field>
void visit_geometry(Geometry& geometry, const Field& field) {
  for (int a = 0; a < 3; ++a) {
    field(geometry.dims[static_cast<std::size_t>(a)]);
    field(geometry.spacing_mm[a]);
    for (int r = 0; r < 3; ++r) field(geometry.direction(r, a));
  }
}

template <class Volume, class Field>
void visit_plain(Volume& volume, const Field& field) {
  field(volume.header.layers);
  field(volume.header.has_geometry);
  field(volume.layers_first);
  field(volume.padded);
  field(volume.voxels.big_endian);
  field(volume.voxels.offset);
  field(volume.voxels.skip);
  field(volume.voxels.may_have_more);
  field(volume.voxels.slope);
  field(volume.voxels.intercept);
}

void get_segment_fields(Receiver& in, std::vector<std::pair<std::string, std::string>>& fields) {
  std::uint32_t count = 0;
  in.get(count);
  if (count > kMaxFields) in.fail("its reader reports an impossible volume");
  std::size_t left = kMaxHeaderBytes;
  for (std::uint32_t n = 0; n < count && in.ok(); ++n) {
    auto& [key, text] = fields.emplace_back();
    for (std::string* part : {&key, &text}) {
      in.get(*part, left);
      left -= std::min(left, part->size());
    }
  }
}

void get_notes(Receiver& in, std::vector<std::string>& notes) {
  std::uint32_t count = 0;
  in.get(count);
  if (count > kMaxNotes) in.fail("its reader reports an impossible volume");
  for (std::uint32_t n = 0; n < count && in.ok(); ++n) in.get(notes.emplace_back());
}

Result<VolumeFile> get_volume(Receiver& in, Files files) {
  VolumeFile volume;
  GridGeometry& geometry = volume.header.geometry;
  visit_geometry(geometry, [&](auto& value) { in.get(value); });
  double origin[3]{};
  for (double& coordinate : origin) in.get(coordinate);
  geometry.origin = Point<Patient>(Eigen::Vector3d(origin));
  visit_plain(volume, [&](auto& value) { in.get(value); });
  std::uint32_t file = 0;
  in.get(file);
  get_one_of(in, volume.voxels.encoding, Encoding::kSlices);
  get_one_of(in, volume.voxels.component, Component::kFloat64);
  get_one_of(in, volume.header.meaning, ValueMeaning::kMeasured);
  bool counted_from_end = false;
  std::uint64_t trailing_bytes = 0;
  in.get(counted_from_end);
  in.get(trailing_bytes);
  if (counted_from_end) volume.voxels.trailing_bytes = trailing_bytes;
  in.get(volume.header.placement_doubt);
  get_notes(in, volume.notes);
  get_segment_fields(in, volume.segment_fields);
  if (!in.ok()) return about(in.error(), files);

  const std::string source = files.front().string();
  const VoxelSource& voxels = volume.voxels;
  if (file >= files.size() || volume.header.layers < 1 || volume.header.layers > kMaxLayers ||
      !std::isfinite(voxels.slope) || !std::isfinite(voxels.intercept))
    return impossible_volume(files);
  if (const auto dims = volume_dims({geometry.dims.begin(), geometry.dims.end()}, source); !dims)
    return dims.error();
  if (const auto possible = checked(geometry, source); !possible) return possible.error();
  volume.voxels.file = files[file];
  volume.header.has_segments = !volume.segment_fields.empty();
  return volume;
}

}  // namespace

Error about(Error error, Files files) {
  if (error.kind == ErrorKind::kBadInput && error.where.empty()) {
    error.where = files.front().string();
    error.remedy = "copy or download it again";
  }
  return error;
}

bool send_refusal(reader::ByteTarget& target, const Error& refusal) {
  Sender out(target);
  out.put(static_cast<std::uint8_t>(Answer::kRefusal));
  put(out, refusal);
  return out.ok();
}

bool send_volume(reader::ByteTarget& target, const VolumeFile& volume, Files files) {
  Sender out(target);
  out.put(static_cast<std::uint8_t>(Answer::kVolume));
  visit_geometry(volume.header.geometry, [&](const auto& value) { out.put(value); });
  for (int a = 0; a < 3; ++a) out.put(volume.header.geometry.origin[a]);
  visit_plain(volume, [&](const auto& value) { out.put(value); });
  const auto file = std::ranges::find(files, volume.voxels.file);
  out.put(static_cast<std::uint32_t>(file - files.begin()));
  out.put(static_cast<std::uint8_t>(volume.voxels.encoding));
  out.put(static_cast<std::uint8_t>(volume.voxels.component));
  out.put(static_cast<std::uint8_t>(volume.header.meaning));
  out.put(volume.voxels.trailing_bytes.has_value());
  out.put(volume.voxels.trailing_bytes.value_or(0));
  out.put(volume.header.placement_doubt);
  out.put(static_cast<std::uint32_t>(volume.notes.size()));
  for (const std::string& note : volume.notes) out.put(note);
  out.put(static_cast<std::uint32_t>(volume.segment_fields.size()));
  for (const auto& [key, text] : volume.segment_fields) {
    out.put(key);
    out.put(text);
  }
  return out.ok();
}

bool send_file_request(reader::ByteTarget& target, const OtherFile& requested) {
  Sender out(target);
  out.put(static_cast<std::uint8_t>(Answer::kFileRequest));
  out.put(static_cast<std::uint8_t>(requested.which));
  out.put(requested.name.substr(0, kMaxErrorText));
  return out.ok();
}

bool send_end(reader::ByteTarget& target, const Result<void>& read) {
  Sender out(target);
  out.put(kEnd);
  out.put(read.ok());
  if (!read) put(out, read.error());
  return out.ok();
}

Result<std::variant<VolumeFile, OtherFile>> receive_answer(reader::ByteSource& source, Files files) {
  using Received = std::variant<VolumeFile, OtherFile>;
  Receiver in = receiver(source);
  Answer answer{};
  get_one_of(in, answer, Answer::kFileRequest);
  if (!in.ok()) return about(in.error(), files);
  if (answer == Answer::kRefusal) return get_refusal(in, files);
  if (answer == Answer::kVolume) {
    auto volume = get_volume(in, files);
    if (!volume) return volume.error();
    return Received(*std::move(volume));
  }
  OtherFile requested;
  get_one_of(in, requested.which, OtherFile::Which::kVoxels);
  in.get(requested.name, kMaxErrorText);
  if (!in.ok()) return about(in.error(), files);
  return Received(std::move(requested));
}

Result<void> receive_end(reader::ByteSource& source, Files files) {
  Receiver in = receiver(source);
  bool whole = false;
  in.get(whole);
  if (!in.ok()) return about(in.error(), files);
  if (whole) return {};
  return get_refusal(in, files);
}

Error impossible_volume(Files files) {
  return about(bad_input("", "is damaged: its reader reports an impossible volume"), files);
}

}  // namespace palpate::volume_io
