#include "verbs.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "palpate/base/reading.h"
#include "palpate/cache/cache.h"
#include "palpate/volume_io/placement_options.h"

namespace palpate::app {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

struct Ended {
  int code = -1;
  std::string out, err;
};

std::string read_whole(int descriptor) {
  std::string text(static_cast<std::size_t>(::lseek(descriptor, 0, SEEK_END)), '\0');
  EXPECT_EQ(::pread(descriptor, text.data(), text.size(), 0), static_cast<ssize_t>(text.size()));
  ::close(descriptor);
  return text;
}

Ended run_here(const std::vector<std::string>& arguments) {
  const Streams streams{::open("/dev/null", O_RDONLY | O_CLOEXEC), ::memfd_create("out", MFD_CLOEXEC),
                        ::memfd_create("err", MFD_CLOEXEC)};
  Ended ended;
  ended.code = run(arguments, streams);
  ::close(streams.in);
  ended.out = read_whole(streams.out);
  ended.err = read_whole(streams.err);
  return ended;
}

TEST(Verbs, PrintToTheStreamsTheyAreGiven) {
  for (int repeat = 0; repeat < 2; ++repeat) {
    const Ended done = run_here({"--version"});
    EXPECT_EQ(done.code, 0);
    EXPECT_THAT(done.out, StartsWith("palpate "));
    EXPECT_THAT(done.err, IsEmpty());
  }
}

TEST(Verbs, ReturnExitCodes) {
  const Ended unknown = run_here({"simulat"});
  EXPECT_EQ(unknown.code, 2);
  EXPECT_THAT(unknown.err, HasSubstr("did you mean simulate"));
  const Ended missing = run_here({"info", "/nowhere/scan.nrrd"});
  EXPECT_EQ(missing.code, 1);
  EXPECT_THAT(missing.err, StartsWith("palpate: error: /nowhere/scan.nrrd"));
  EXPECT_THAT(missing.out, IsEmpty());
}

TEST(Verbs, OutputThatIsLostIsAFailure) {
  const int full = ::open("/dev/full", O_WRONLY | O_CLOEXEC), err = ::memfd_create("err", MFD_CLOEXEC);
  EXPECT_EQ(run({"--version"}, {STDIN_FILENO, full, err}), 4);
  ::close(full);
  EXPECT_THAT(read_whole(err), HasSubstr("standard output: cannot be written"));
  EXPECT_EQ(run_here({"--version"}).code, 0);
}

TEST(Verbs, LibraryExcludesCompanionVerbs) {
  for (const auto& command : std::vector<std::vector<std::string>>{
           {"verify", "--list"}, {"--quiet", "verify"}, {"--memory", "1G", "verify"}}) {
    const Ended missing = run_here(command);
    EXPECT_EQ(missing.code, 5);
    EXPECT_THAT(missing.err, HasSubstr("palpate-verify"));
    EXPECT_THAT(missing.out, IsEmpty());
  }
  for (const auto& command :
       std::vector<std::vector<std::string>>{{"verify", "--help"}, {"verify", "-h"}, {"help", "verify"}}) {
    const Ended help = run_here(command);
    EXPECT_EQ(help.code, 0);
    EXPECT_THAT(help.out, HasSubstr("install it in the same folder"));
    EXPECT_THAT(help.err, IsEmpty());
  }
  // the name of a companion program has no effect after another verb
  EXPECT_EQ(run_here({"info", "verify"}).code, 1);
}

TEST(Verbs, HelpOfAVerbOmitsTheProgramsExamples) {
  const std::string exit_codes = "Exit codes";
  EXPECT_THAT(run_here({"--help"}).out, HasSubstr(exit_codes));
  for (const std::string verb : {"plan", "task", "data"})
    EXPECT_THAT(run_here({verb, "--help"}).out, ::testing::Not(HasSubstr(exit_codes))) << verb;
}

TEST(Verbs, HelpOfRenderListsTheSides) {
  const std::string help = run_here({"render", "--help"}).out;
  EXPECT_THAT(help, HasSubstr("SIDE:{anterior,"));
  EXPECT_THAT(help, ::testing::Not(HasSubstr("->")));
}

TEST(Verbs, LeaveTheProcessAsTheyFoundIt) {
  const std::filesystem::path folder = std::filesystem::temp_directory_path() / "palpate-verbs-test-cache";
  ::setenv("PALPATE_CACHE", folder.c_str(), 1);
  struct sigaction before[4], after[4];
  const int signals[] = {SIGINT, SIGTERM, SIGPIPE, SIGXFSZ};
  for (int n = 0; n < 4; ++n) ::sigaction(signals[n], nullptr, &before[n]);
  std::FILE* const out = stdout;
  std::FILE* const err = stderr;
  std::streambuf* const buffer = std::cout.rdbuf();
  const auto format = std::cout.flags();

  const Ended done =
      run_here({"--memory", "800M", "--follow-links", "--mesh-space", "ras", "--mesh-unit", "cm", "--spacing",
                "0.1,0.1,0.2", "--form", "q", "--cropped-scan", "cache", "show"});
  EXPECT_EQ(done.code, 0) << done.err;
  EXPECT_THAT(done.out, HasSubstr(folder.string()));

  EXPECT_EQ(reading_limits().max_memory_bytes, ReadingLimits{}.max_memory_bytes);
  EXPECT_FALSE(reading_limits().follow_links);
  EXPECT_FALSE(placement_options().mesh.space.has_value());
  EXPECT_FALSE(placement_options().mesh.unit_mm.has_value());
  EXPECT_FALSE(placement_options().image_spacing_mm.has_value());
  EXPECT_FALSE(placement_options().nifti_form.has_value());
  EXPECT_FALSE(placement_options().scan_is_cropped);
  EXPECT_TRUE(cache_settings().folder.empty());
  for (int n = 0; n < 4; ++n) {
    ::sigaction(signals[n], nullptr, &after[n]);
    EXPECT_EQ(after[n].sa_handler, before[n].sa_handler) << signals[n];
  }
  EXPECT_EQ(stdout, out);
  EXPECT_EQ(stderr, err);
  EXPECT_EQ(std::cout.rdbuf(), buffer);
  EXPECT_EQ(std::cout.flags(), format);
  ::unsetenv("PALPATE_CACHE");
}

}  // namespace
}  // namespace palpate::app
