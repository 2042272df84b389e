// Four targets, selected by the first byte:
//   0 - 31     a stream with a valid head, followed by the input
//   32 - 127   the stream of the reading process, as a compromised process might send it
//   128 - 247  a recording with replaced data sets and attributes, read by HDF5 and this module's checks
//              in this process
//   248 - 255  a valid recording with modified bytes, through read_recording and its child process
#include <hdf5.h>
#include <pthread.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <string>
#include <utility>

#include "palpate/recording/recorder.h"
#include "recording/columns.h"
#include "recording/hdf5_handle.h"
#include "recording/hdf5_reader.h"
#include "recording/test_support.h"

extern "C" void __sanitizer_set_death_callback(void (*)());

namespace {

using namespace palpate;
using internal::Handle;

// the fuzzer's input, followed by zeros
class Input {
 public:
  explicit Input(std::span<const std::uint8_t> bytes) : remaining_(bytes) {}
  bool empty() const { return remaining_.empty(); }
  std::uint64_t number(std::size_t bytes) {
    std::uint64_t value = 0;
    const std::size_t count = std::min(bytes, remaining_.size());
    std::copy_n(remaining_.begin(), count, reinterpret_cast<std::uint8_t*>(&value));
    remaining_ = remaining_.subspan(count);
    return value;
  }
  std::span<const std::byte> remaining() const { return std::as_bytes(remaining_); }

 private:
  std::span<const std::uint8_t> remaining_;
};

void must(bool condition) {
  if (!condition) std::abort();
}

// results must be within the bounds that callers rely on
void check(const Result<Recording>& read) {
  if (!read) return must(!read.error().what.empty());
  const RecordingHeader& header = read.value().header;
  if (read.value().summary) must(read.value().summary->problems.size() <= 1000);
  must(header.clock == "virtual" || header.clock == "real");
  must(header.devices >= 1 && header.devices <= 4 && header.rate_hz > 0 &&
       header.script_text.size() <= (16u << 20));
  for (const TickRecord& tick : read.value().ticks) must(tick.devices == header.devices);
  std::uint64_t last_tick = 0;
  for (const RecordingEvent& event : read.value().events) {
    must(event.kind <= RecordingEvent::Kind::kTissueSolution &&
         event.by.originator <= Originator::kViewerWithConsent);
    must(event.tick >= std::exchange(last_tick, event.tick));
  }
}

const std::vector<std::byte>& valid_recording() {
  static const std::vector<std::byte> bytes = [] {
    const test::TemporaryFolder folder;
    auto writer = RecordingWriter::create(folder / "run.h5", test::example_header(1, 8));
    must(writer.ok());
    must((*writer)->append(test::example_ticks(20, 1, 8), test::example_events()).ok());
    must((*writer)->finish(test::example_summary(20)).ok());
    return test::read_bytes(folder / "run.h5");
  }();
  return bytes;
}

void receive(std::span<const std::byte> bytes) {
  test::MemorySource source(bytes);
  check(test::receive_all(source));
}

void receive_after_head(std::span<const std::byte> bytes) {
  test::MemoryTarget stream;
  must(internal::send_head(stream, {test::example_header(1), std::nullopt, 3, true, {{0, 0}}}));
  stream.write(bytes);
  receive(stream.bytes);
}

// a type that occurs in recordings, or some other
Handle any_type(Input& input) {
  const std::array plain{H5T_STD_U8LE,   H5T_STD_U16LE,  H5T_STD_U32LE,  H5T_STD_U64LE, H5T_STD_I64BE,
                         H5T_IEEE_F64LE, H5T_IEEE_F64BE, H5T_IEEE_F32LE, H5T_C_S1};
  const std::size_t kind = input.number(1) % (plain.size() + 2);
  if (kind == plain.size()) {
    Handle variable(H5Tcopy(H5T_C_S1), H5Tclose);
    H5Tset_size(variable.get(), H5T_VARIABLE);
    return variable;
  }
  if (kind > plain.size()) {
    const hsize_t dims = 1 + input.number(1);
    return Handle(H5Tarray_create2(H5T_IEEE_F64LE, 1, &dims), H5Tclose);
  }
  Handle type(H5Tcopy(plain[kind]), H5Tclose);
  if (plain[kind] == H5T_C_S1) H5Tset_size(type.get(), 1 + input.number(2));
  return type;
}

// replaces the data set `name`
void replace_data_set(hid_t file, const std::string& name, Input& input) {
  H5Ldelete(file, name.c_str(), H5P_DEFAULT);
  const int rank = static_cast<int>(input.number(1) % 4);
  hsize_t dims[3], chunk[3];
  for (int i = 0; i < rank; ++i) {
    // mostly plausible lengths
    const std::uint64_t kind = input.number(1);
    dims[i] = kind < 100 ? 20 : kind < 200 ? kind % 5 : input.number(8) >> (kind % 64);
    chunk[i] = std::clamp<hsize_t>(input.number(2), 1, std::max<hsize_t>(dims[i], 1));
  }
  // a single kind of storage: HDF5 itself crashes on some contradictory combinations
  const std::uint64_t layout = input.number(1) % 6;
  const Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  if (layout < 3 && rank > 0) H5Pset_chunk(properties.get(), rank, chunk);
  if (layout == 1 && rank > 0) H5Pset_deflate(properties.get(), 1);
  if (layout == 3) H5Pset_layout(properties.get(), H5D_COMPACT);
  if (layout == 4) H5Pset_external(properties.get(), "/etc/hostname", 0, 8);
  const Handle type = any_type(input);
  const Handle space(rank == 0 ? H5Screate(H5S_SCALAR) : H5Screate_simple(rank, dims, nullptr), H5Sclose);
  const Handle made(
      H5Dcreate2(file, name.c_str(), type.get(), space.get(), H5P_DEFAULT, properties.get(), H5P_DEFAULT),
      H5Dclose);
  // some of the small ones contain data
  std::array<std::uint64_t, 512> values{};
  for (std::uint64_t& value : values) value = input.number(1);
  if (made.ok() && input.number(1) % 4 != 0 && H5Sget_simple_extent_npoints(space.get()) <= 60 &&
      H5Tget_size(type.get()) <= 64 && H5Tget_class(type.get()) != H5T_STRING)
    H5Dwrite(made.get(), type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
}

void replace_attribute(hid_t object, const std::string& name, Input& input) {
  H5Adelete(object, name.c_str());
  const Handle type = any_type(input);
  const hsize_t count = input.number(1) % 3;
  const Handle space(count == 0 ? H5Screate(H5S_SCALAR) : H5Screate_simple(1, &count, nullptr), H5Sclose);
  const Handle made(H5Acreate2(object, name.c_str(), type.get(), space.get(), H5P_DEFAULT, H5P_DEFAULT),
                    H5Aclose);
  if (!made.ok() || H5Tis_variable_str(type.get()) > 0) return;
  std::vector<std::uint8_t> value(H5Tget_size(type.get()) * 3);
  for (std::uint8_t& byte : value) byte = static_cast<std::uint8_t>(input.number(1));
  H5Awrite(made.get(), type.get(), value.data());
}

// all names that the reader accesses
const std::vector<std::string>& data_set_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all{"header/script",   "structures/label",  "structures/colour",
                                 "structures/name", "structures/tissue", "summary/complete",
                                 "summary/ticks",   "summary/run_hash",  "summary/trouble"};
    for (const auto& column : internal::event_columns()) all.push_back(std::string("events/") + column.name);
    for (const auto& column : internal::tick_columns()) all.push_back(std::string("ticks/") + column.name);
    for (const auto& column : internal::device_columns())
      all.push_back(std::string("device0/") + column.name);
    return all;
  }();
  return names;
}

void rebuild(Input& input) {
  static const std::array header{"palpate_version", "scene_title", "model_hash", "rate_hz",   "seed",
                                 "simulated",       "devices",     "clock",      "scheduler", "feel"};
  static const std::array root{"format", "format_major"};
  static const std::array groups{"ticks", "device0", "header", "structures", "summary", "events"};
  const test::TemporaryFolder folder;
  const auto scratch = folder / "run.h5";
  test::write_bytes(scratch, valid_recording());
  const internal::Hdf5Section section;
  {
    const Handle file(H5Fopen(scratch.c_str(), H5F_ACC_RDWR, H5P_DEFAULT), H5Fclose);
    must(file.ok());
    for (int changes = 0; changes < 4 && !input.empty(); ++changes) {
      const std::uint64_t what = input.number(1) % 8, which = input.number(1);
      if (what < 4) {
        replace_data_set(file.get(), data_set_names()[which % data_set_names().size()], input);
      } else if (what < 6) {
        const Handle group(H5Gopen2(file.get(), "header", H5P_DEFAULT), H5Gclose);
        if (group.ok()) replace_attribute(group.get(), header[which % header.size()], input);
      } else if (what == 6) {
        replace_attribute(file.get(), root[which % root.size()], input);
      } else {
        const char* name = groups[which % groups.size()];
        H5Ldelete(file.get(), name, H5P_DEFAULT);
        if (which % 2 != 0) H5Lcreate_soft("/ticks", file.get(), name, H5P_DEFAULT, H5P_DEFAULT);
      }
    }
  }
  test::MemoryTarget sent;
  const bool whole = internal::send_recording(scratch, sent);
  test::MemorySource source(sent.bytes);
  const auto read = test::receive_all(source);
  check(read);
  must(whole || !read);
}

// pairs of an offset and a byte in a valid file
void change_bytes(Input& input) {
  std::vector<std::byte> bytes = valid_recording();
  while (!input.empty()) {
    const std::uint64_t index = input.number(2);
    bytes[index % bytes.size()] = static_cast<std::byte>(input.number(1));
  }
  const test::TemporaryFolder folder;
  const auto scratch = folder / "run.h5";
  test::write_bytes(scratch, bytes);
  check(read_recording(scratch));
}

// a crash of the child process is expected and not a finding
void excuse_child() {
  __sanitizer_set_death_callback(nullptr);
  for (const int signal : {SIGSEGV, SIGBUS, SIGABRT, SIGFPE, SIGILL, SIGALRM}) ::signal(signal, SIG_DFL);
}

}  // namespace

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  ::pthread_atfork(nullptr, nullptr, excuse_child);
  static_cast<void>(valid_recording());
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Input input({data, size});
  const std::uint64_t distance = input.number(1);
  if (distance < 32)
    receive_after_head(input.remaining());
  else if (distance < 128)
    receive(input.remaining());
  else if (distance < 248)
    rebuild(input);
  else
    change_bytes(input);
  return 0;
}
