// Actions that are denied to a confined process. A sanitizer's runtime could not run in one.
#include "reader/confine.h"

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

#include <fcntl.h>
#include <gtest/gtest.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>
#include <vector>

#include "base/test_child.h"
#include "base/test_folder.h"
#include "palpate/base/check.h"
#include "palpate/base/file.h"
#include "palpate/reader/reader_process.h"

namespace palpate::reader {
namespace {

class Confined : public ::testing::Test {
 protected:
  void SetUp() override {
    std::ofstream(file_) << "content";
    std::ofstream(other_) << "somebody else's";
  }

  // outcome of an attempt in a confined process: 0, or its errno; -1 if the process was killed
  int outcome(const std::function<long()>& attempt) const {
    auto opened = InputFile::open(file_);
    PALPATE_CHECK(opened.ok());
    return outcome(*opened, attempt);
  }
  static int outcome(const InputFile& file, const std::function<long()>& attempt) {
    return outcome(file.descriptor(), attempt);
  }
  static int outcome(int descriptor, const std::function<long()>& attempt) {
    ReaderProcess::Job job;
    job.files = {&descriptor, 1};
    const Progress silent;
    const auto process = ReaderProcess::start(
        job,
        [&](ParentEnd& parent) {
          const int error = attempt() == -1 ? errno : 0;
          return parent.write(std::as_bytes(std::span(&error, 1)));
        },
        silent);
    PALPATE_CHECK(process.ok());
    int error = 0;
    return (*process)->read(std::as_writable_bytes(std::span(&error, 1))) ? error : -1;
  }
  static int open_to_read(const std::filesystem::path& file) { return ::open(file.c_str(), O_RDONLY); }

  const test::TemporaryFolder folder_;
  const std::filesystem::path file_ = folder_ / "file", other_ = folder_ / "other";
};

TEST_F(Confined, ReadsItsFile) {
  EXPECT_EQ(outcome([&] { return open_to_read(file_); }), 0);
  EXPECT_EQ(outcome([&] {
              std::stringstream content;
              content << std::ifstream(file_).rdbuf();
              return content.str() == "content" ? 0 : -1;
            }),
            0);
  // memory, as much as any reader needs
  EXPECT_EQ(outcome([] {
              void* much = std::malloc(std::size_t{512} << 20);
              if (much != nullptr) std::memset(much, 1, std::size_t{512} << 20);
              return much == nullptr ? -1 : 0;
            }),
            0);
}

TEST_F(Confined, GetsNoMemoryWithoutEnd) {
  EXPECT_EQ(outcome([] {
              return ::mmap(nullptr, std::size_t{2} << 30, PROT_READ | PROT_WRITE,
                            MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) == MAP_FAILED
                         ? -1
                         : 0;
            }),
            ENOMEM);
  EXPECT_EQ(outcome([] {
              const std::string much(std::size_t{2} << 30, 'x');
              return static_cast<long>(much.size());
            }),
            -1);
}

TEST_F(Confined, OpensNoOtherFile) {
  if (!can_restrict_files())
    GTEST_SKIP() << "this kernel has no Landlock: nothing but its limits hold a reader";
  EXPECT_EQ(outcome([&] { return open_to_read(other_); }), EACCES);
  EXPECT_EQ(outcome([&] { return open_to_read("/etc/passwd"); }), EACCES);
  EXPECT_EQ(outcome([&] { return open_to_read("/proc/self/environ"); }), EACCES);
  EXPECT_EQ(outcome([&] { return ::open(folder_.path().c_str(), O_RDONLY | O_DIRECTORY); }), EACCES);
}

TEST_F(Confined, OpensFilesInAndBelowAFolder) {
  if (!can_restrict_files()) GTEST_SKIP() << "this kernel has no Landlock";
  std::filesystem::create_directories(folder_ / "given" / "below");
  std::ofstream(folder_ / "given" / "below" / "inside") << "content";
  std::filesystem::create_symlink(other_, folder_ / "given" / "link");
  const int supplied = ::open((folder_ / "given").c_str(), O_RDONLY | O_DIRECTORY);
  ASSERT_GE(supplied, 0);
  EXPECT_EQ(outcome(supplied, [&] { return open_to_read(folder_ / "given" / "below" / "inside"); }), 0);
  EXPECT_EQ(outcome(supplied, [&] { return open_to_read(other_); }), EACCES);
  EXPECT_EQ(outcome(supplied, [&] { return open_to_read(folder_ / "given" / "link"); }), EACCES);
  EXPECT_EQ(outcome(supplied, [&] { return ::openat(supplied, "../other", O_RDONLY); }), EACCES);
  ::close(supplied);
}

TEST_F(Confined, OpensNothingElseUnderTheNameOfItsFile) {
  if (!can_restrict_files())
    GTEST_SKIP() << "this kernel has no Landlock: a reader opens what stands under the name";
  const auto opened = InputFile::open(file_);
  ASSERT_TRUE(opened);
  // a library opens by name a file that was examined before
  std::filesystem::rename(other_, file_);
  EXPECT_EQ(outcome(*opened, [&] { return open_to_read(file_); }), EACCES);
  EXPECT_EQ(outcome(*opened, [&] { return open_to_read(opened->name_for_libraries()); }), 0);
  std::filesystem::remove(file_);
  std::filesystem::create_symlink("/etc/passwd", file_);
  EXPECT_EQ(outcome(*opened, [&] { return open_to_read(file_); }), EACCES);
}

TEST_F(Confined, HasNoNetworkAccess) {
  if (!can_restrict_system_calls())
    GTEST_SKIP() << "this kernel has no seccomp: nothing but its limits hold a reader";
  const pid_t test = ::getpid();
  const auto refused = [&](const char* what, const std::function<long()>& attempt) {
    EXPECT_EQ(outcome(attempt), EPERM) << what;
  };
  refused("a socket", [] { return ::socket(AF_INET, SOCK_STREAM, 0); });
  refused("a local socket", [] { return ::socket(AF_UNIX, SOCK_STREAM, 0); });
  refused("a program", [] {
    char name[] = "/bin/true";
    char* arguments[] = {name, nullptr};
    return ::execv(name, arguments);
  });
  refused("a process", [] { return ::fork(); });
  refused("a thread", [] { return ::syscall(SYS_clone, SIGCHLD, nullptr, nullptr, nullptr, nullptr); });
  refused("a signal", [&] { return ::kill(test, SIGTERM); });
  refused("a signal to a thread", [&] { return ::syscall(SYS_tgkill, test, test, SIGTERM); });
  refused("another's memory", [&] { return ::ptrace(PTRACE_ATTACH, test, nullptr, nullptr); });
  refused("another's memory", [&] {
    iovec nothing{};
    return ::process_vm_readv(test, &nothing, 1, &nothing, 1, 0);
  });
  refused("the terminal", [] { return ::ioctl(0, TIOCSTI, "x"); });
  refused("signals for input", [&] { return ::fcntl(3, F_SETOWN, test); });
  refused("another's limits", [&] {
    const rlimit none{};
    return ::prlimit(test, RLIMIT_AS, &none, nullptr);
  });
  refused("its own limits", [&] {
    const rlimit none{};
    return ::setrlimit(RLIMIT_CORE, &none);
  });
}

TEST_F(Confined, ChangesNothing) {
  if (!can_restrict_system_calls())
    GTEST_SKIP() << "this kernel has no seccomp: nothing but its limits hold a reader";
  const auto refused = [&](const char* what, const std::function<long()>& attempt) {
    EXPECT_EQ(outcome(attempt), EPERM) << what;
  };
  for (const int flags :
       {O_WRONLY, O_RDWR, O_RDONLY | O_TRUNC, O_RDONLY | O_CREAT, O_RDONLY | O_APPEND | O_RDWR})
    refused("its file", [&] { return ::open(file_.c_str(), flags, 0600); });
  refused("a new file", [&] { return ::open((folder_ / "new").c_str(), O_WRONLY | O_CREAT, 0600); });
  refused("a file without a name", [&] { return ::open(folder_.path().c_str(), O_TMPFILE | O_RDWR, 0600); });
  refused("a name", [&] { return ::rename(other_.c_str(), file_.c_str()); });
  refused("a name", [&] { return ::unlink(other_.c_str()); });
  refused("a folder", [&] { return ::mkdir((folder_ / "new").c_str(), 0700); });
  refused("permissions", [&] { return ::chmod(file_.c_str(), 0777); });
  refused("a size", [&] { return ::truncate(file_.c_str(), 0); });
  refused("code", [] {
    return ::mmap(nullptr, 4096, PROT_READ | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) == MAP_FAILED ? -1
                                                                                                          : 0;
  });
  refused("code", [] {
    void* page = ::mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    return ::mprotect(page, 4096, PROT_READ | PROT_EXEC);
  });
  EXPECT_EQ(folder_.count(), 2u);
}

// emulates a kernel without Landlock or without seccomp filters
void become_old_kernel(bool without_files, bool without_calls) {
  constexpr auto kRefuse = [](std::uint32_t error) {
    return sock_filter BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | error);
  };
  std::vector<sock_filter> code{BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr))};
  if (without_files) {
    code.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_landlock_create_ruleset, 0, 1));
    code.push_back(kRefuse(ENOSYS));
  }
  if (without_calls) {
    code.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_prctl, 0, 3));
    code.push_back(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, args)));
    code.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, PR_SET_SECCOMP, 0, 1));
    code.push_back(kRefuse(EINVAL));
  }
  code.push_back(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW));
  const sock_fprog program{static_cast<unsigned short>(code.size()), code.data()};
  PALPATE_CHECK(::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0);
  PALPATE_CHECK(::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0);
}

TEST_F(Confined, ReadsOnWhereTheKernelLacksAWall) {
  if (!can_restrict_system_calls())
    GTEST_SKIP() << "this kernel has no seccomp, by which another one is played";
  const bool has_landlock = can_restrict_files();
  for (const bool without_files : {false, true})
    for (const bool without_calls : {false, true}) {
      palpate::testing::Child kernel([&] {
        become_old_kernel(without_files, without_calls);
        PALPATE_CHECK(can_restrict_system_calls() == !without_calls);
        PALPATE_CHECK(can_restrict_files() == (has_landlock && !without_files));
        PALPATE_CHECK(outcome([&] { return open_to_read(file_); }) == 0);
        // each mechanism works independently
        PALPATE_CHECK(outcome([&] { return open_to_read(other_); }) == (can_restrict_files() ? EACCES : 0));
        PALPATE_CHECK(outcome([] { return ::socket(AF_UNIX, SOCK_STREAM, 0); }) ==
                      (without_calls ? 0 : EPERM));
        PALPATE_CHECK(outcome([&] { return ::truncate(file_.c_str(), 0); }) == (without_calls ? 0 : EPERM));
        std::ofstream(file_) << "content";
      });
      EXPECT_TRUE(kernel.finished()) << without_files << without_calls;
    }
}

TEST_F(Confined, ReadsWhereTheProgramHasNoStdin) {
  const int saved = ::dup(0);
  ::close(0);
  EXPECT_EQ(outcome([] {
              char content[8] = "";
              return ::pread(0, content, 7, 0) == 7 && std::strcmp(content, "content") == 0 ? 0 : -1;
            }),
            0);
  ::dup2(saved, 0);
  ::close(saved);
}

TEST_F(Confined, ByTheLimitsAloneToo) {
  // restrictions that apply without Landlock and seccomp
  EXPECT_EQ(outcome([] {
              rlimit files{}, cores{}, size{};
              ::getrlimit(RLIMIT_NOFILE, &files);
              ::getrlimit(RLIMIT_CORE, &cores);
              ::getrlimit(RLIMIT_FSIZE, &size);
              return files.rlim_max <= 64 && cores.rlim_max == 0 && size.rlim_max == 0 ? 0 : -1;
            }),
            0);
}

}  // namespace
}  // namespace palpate::reader

#endif
