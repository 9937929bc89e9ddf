/*
 * User Mode Linux 6.1 keeps 4 KB of a process' extended registers. Where the processor has more (AMX: 11 KB) the
 * kernel refuses to set registers by a part of them (EFAULT), and the guest dies with its first process. So what is
 * set is laid over what is there. Preloaded into the guest by canvm.sh, on such processors alone.
 *
 *   gcc -O2 -shared -fPIC -o xstate.so xstate.c
 */
#define _GNU_SOURCE
#include <elf.h>
#include <errno.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

/* Not on the stack, which is the guest kernel's and small. One processor, one thread. */
static char whole[64 * 1024];

static long set_part(pid_t pid, void *kind, const struct iovec *part)
{
	struct iovec all = {whole, sizeof whole};

	if (syscall(SYS_ptrace, PTRACE_GETREGSET, pid, kind, &all))
		return -1;
	memcpy(whole, part->iov_base, part->iov_len < all.iov_len ? part->iov_len : all.iov_len);
	return syscall(SYS_ptrace, PTRACE_SETREGSET, pid, kind, &all);
}

long ptrace(enum __ptrace_request request, ...)
{
	va_list rest;
	va_start(rest, request);
	pid_t pid = va_arg(rest, pid_t);
	void *addr = va_arg(rest, void *);
	void *data = va_arg(rest, void *);
	va_end(rest);

	if (request == PTRACE_PEEKTEXT || request == PTRACE_PEEKDATA || request == PTRACE_PEEKUSER) {
		long word;
		long failed = syscall(SYS_ptrace, request, pid, addr, &word);
		if (!failed)
			errno = 0;
		return failed ? failed : word;
	}
	long done = syscall(SYS_ptrace, request, pid, addr, data);
	if (done && errno == EFAULT && request == PTRACE_SETREGSET && addr == (void *)NT_X86_XSTATE)
		done = set_part(pid, addr, data);
	return done;
}
