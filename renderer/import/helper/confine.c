/* How the helper locks itself in before it reads the first byte. Each layer works without the others: limits keep it
 * from exhausting the machine, Landlock from other files, dropped capabilities from root's privileges, seccomp from
 * every system call that is not reading, computing and answering. */
#include <errno.h>
#include <fcntl.h>
#include <linux/capability.h>
#include <linux/landlock.h>
#include <seccomp.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "renderer/import/helper/confine.h"

/* Sanitizers map terabytes of shadow memory, so only real builds limit the address space. */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define SANITIZED 1
#endif
#endif
#ifndef SANITIZED
#define SANITIZED 0
#endif

/* Limit on the user's tasks, including the daemon's own. Beyond it the helper works without threads. */
#define PROCESSES 4096

static void limit(int what, uint64_t value) {
  struct rlimit now;
  if (getrlimit((__rlimit_resource_t)what, &now) != 0) return;
  if (now.rlim_max == RLIM_INFINITY || value < now.rlim_max) now.rlim_max = value;
  now.rlim_cur = now.rlim_max;
  setrlimit((__rlimit_resource_t)what, &now);
}

static void set_limits(uint64_t address_bytes, uint64_t cpu_seconds) {
  limit(RLIMIT_CORE, 0);
  limit(RLIMIT_FSIZE, 0);
  limit(RLIMIT_NOFILE, 64);
  limit(RLIMIT_NPROC, PROCESSES);
  limit(RLIMIT_CPU, cpu_seconds);
  if (!SANITIZED) limit(RLIMIT_AS, address_bytes);
}

/* Opens the target of links in a git-annex or DataLad folder: .git/annex/objects in the folder or above it; -1
 * without one. */
static int open_annex(int folder) {
  enum { LEVELS = 32 };
  int at = openat(folder, ".", O_PATH | O_DIRECTORY | O_CLOEXEC), objects = -1;
  for (int level = 0; at >= 0 && level < LEVELS; level++) {
    objects = openat(at, ".git/annex/objects", O_PATH | O_DIRECTORY | O_CLOEXEC);
    int up = objects < 0 ? openat(at, "..", O_PATH | O_DIRECTORY | O_CLOEXEC) : -1;
    close(at);
    at = up;
  }
  if (at >= 0) close(at);
  return objects;
}

static void allow_beneath(int set, int folder) {
  const struct landlock_path_beneath_attr beneath = {
      .allowed_access = LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR, .parent_fd = folder};
  syscall(SYS_landlock_add_rule, set, LANDLOCK_RULE_PATH_BENEATH, &beneath, 0);
}

static bool is_folder(int fd) {
  struct stat st;
  return fstat(fd, &st) == 0 && S_ISDIR(st.st_mode);
}

/* Removes all access to files except reading below the input folder, its annex and the link roots; an input file is
 * open already. False if the kernel has no Landlock. */
static bool restrict_files(int input_fd, uint32_t link_roots) {
  enum { FIRST_RIGHTS = (1 << 13) - 1, REFER = 1 << 13, TRUNCATE = 1 << 14 };
  long abi = syscall(SYS_landlock_create_ruleset, NULL, 0, LANDLOCK_CREATE_RULESET_VERSION);
  if (abi < 1) return false;
  struct landlock_ruleset_attr rules = {.handled_access_fs = FIRST_RIGHTS};
  if (abi >= 2) rules.handled_access_fs |= REFER;
  if (abi >= 3) rules.handled_access_fs |= TRUNCATE;
  int set = (int)syscall(SYS_landlock_create_ruleset, &rules, sizeof rules, 0);
  if (set < 0) return false;
  const bool folder = is_folder(input_fd);
  int annex = folder ? open_annex(input_fd) : -1;
  if (folder) allow_beneath(set, input_fd);
  for (uint32_t i = 0; i < link_roots; i++) {
    allow_beneath(set, TC_HELPER_LINKS_FD + (int)i);
    close(TC_HELPER_LINKS_FD + (int)i);
  }
  if (annex >= 0) {
    allow_beneath(set, annex);
    close(annex);
  }
  bool ok = syscall(SYS_landlock_restrict_self, set, 0) == 0;
  close(set);
  return ok;
}

/* Drops root's privileges. */
static bool drop_capabilities(void) {
  struct __user_cap_header_struct header = {.version = _LINUX_CAPABILITY_VERSION_3};
  struct __user_cap_data_struct none[_LINUX_CAPABILITY_U32S_3] = {{0}};
  return syscall(SYS_capset, &header, none) == 0;
}

/* Makes the kernel's out-of-memory killer choose the helper before the daemon. */
static void go_first(void) {
  int fd = open("/proc/self/oom_score_adj", O_WRONLY | O_CLOEXEC);
  if (fd < 0) return;
  if (write(fd, "1000", 4) < 0) errno = 0; /* without this file the kernel chooses by size */
  close(fd);
}

/* The system calls of decoders. openat, mmap, mprotect and clone are allowed under conditions, below. */
static const int allowed_calls[] = {
    SCMP_SYS(read),
    SCMP_SYS(pread64),
    SCMP_SYS(readv),
    SCMP_SYS(recvmsg),
    SCMP_SYS(write),
    SCMP_SYS(writev),
    SCMP_SYS(close),
    SCMP_SYS(dup),
    SCMP_SYS(fstat),
    SCMP_SYS(newfstatat),
    SCMP_SYS(statx),
    SCMP_SYS(lseek),
    SCMP_SYS(getdents64),
    SCMP_SYS(munmap),
    SCMP_SYS(mremap),
    SCMP_SYS(brk),
    SCMP_SYS(madvise),
    SCMP_SYS(futex),
    SCMP_SYS(exit),
    SCMP_SYS(exit_group),
    SCMP_SYS(rt_sigreturn),
    SCMP_SYS(rt_sigprocmask),
    SCMP_SYS(rt_sigaction),
    SCMP_SYS(sigaltstack),
    SCMP_SYS(getrandom),
    SCMP_SYS(clock_gettime),
    SCMP_SYS(clock_nanosleep),
    SCMP_SYS(gettimeofday),
    SCMP_SYS(getpid),
    SCMP_SYS(gettid),
    SCMP_SYS(sched_yield),
    SCMP_SYS(sched_getaffinity),
    SCMP_SYS(sysinfo),
    SCMP_SYS(getrusage),
    SCMP_SYS(set_robust_list),
    SCMP_SYS(rseq),
    SCMP_SYS(restart_syscall),
    SCMP_SYS(fcntl),
};

#if SANITIZED /* sanitizers probe memory by writing it into a pipe, and read their own name */
static const int sanitizer_calls[] = {SCMP_SYS(pipe), SCMP_SYS(pipe2), SCMP_SYS(readlink), SCMP_SYS(readlinkat)};
#endif

enum { CLONE_THREAD_BIT = 0x00010000, TMPFILE_BIT = 020000000 };

static int allow_calls(scmp_filter_ctx filter) {
  int bad = 0;
  for (size_t i = 0; i < G_N_ELEMENTS(allowed_calls); i++)
    bad |= seccomp_rule_add(filter, SCMP_ACT_ALLOW, allowed_calls[i], 0);
#if SANITIZED
  for (size_t i = 0; i < G_N_ELEMENTS(sanitizer_calls); i++)
    bad |= seccomp_rule_add(filter, SCMP_ACT_ALLOW, sanitizer_calls[i], 0);
#endif
  /* abort(): signals only to this process */
  bad |= seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(tgkill), 1, SCMP_A0(SCMP_CMP_EQ, (scmp_datum_t)getpid()));
  /* files open read-only */
  bad |= seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(openat), 1,
                          SCMP_A2(SCMP_CMP_MASKED_EQ, O_ACCMODE | O_CREAT | O_TRUNC | TMPFILE_BIT, O_RDONLY));
  /* no executable memory */
  bad |= seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(mmap), 1, SCMP_A2(SCMP_CMP_MASKED_EQ, PROT_EXEC, 0));
  bad |= seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(mprotect), 1, SCMP_A2(SCMP_CMP_MASKED_EQ, PROT_EXEC, 0));
  /* threads, but no processes; clone3 hides its flags behind a pointer, so the C library must fall back to clone */
  bad |= seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(clone), 1,
                          SCMP_A0(SCMP_CMP_MASKED_EQ, CLONE_THREAD_BIT, CLONE_THREAD_BIT));
  bad |= seccomp_rule_add(filter, SCMP_ACT_ERRNO(ENOSYS), SCMP_SYS(clone3), 0);
  return bad;
}

/* All other calls return EPERM, so that a C library that tries a newer call falls back to an older one. */
static bool restrict_calls(GError **error) {
  scmp_filter_ctx filter = seccomp_init(SCMP_ACT_ERRNO(EPERM));
  int bad = filter ? allow_calls(filter) : -1;
  if (filter && bad == 0) bad = seccomp_load(filter);
  if (filter) seccomp_release(filter);
  if (bad == 0) return true;
  tc_set_error(error, TC_ERROR_IO, NULL,
               "nothing is decoded: this system lets the decoder not be confined (no seccomp)");
  return false;
}

bool tc_confine(int input_fd, const tc_helper_request *request, GError **error) {
  go_first();
  prctl(PR_SET_DUMPABLE, 0, 0, 0, 0);
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 || !drop_capabilities()) {
    tc_set_error(error, TC_ERROR_IO, NULL, "nothing is decoded: this system lets the decoder not be confined");
    return false;
  }
  set_limits(request->address_bytes, request->cpu_seconds);
  if (!restrict_files(input_fd, request->link_roots) && !request->without_landlock) {
    tc_set_error(error, TC_ERROR_IO, NULL,
                 "nothing is decoded: this kernel has no Landlock to keep the decoder from other files; set"
                 " TOMOCAST_WITHOUT_LANDLOCK=1 to do without");
    return false;
  }
  return restrict_calls(error);
}
