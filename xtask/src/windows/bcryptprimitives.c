/* What Rust's standard library takes from bcryptprimitives.dll, which Wine has from version 8.13 on and Debian 12 not yet. */
#include <windows.h>
#include <ntsecapi.h>

__declspec(dllexport) BOOL WINAPI ProcessPrng(PBYTE data, SIZE_T size)
{
    return RtlGenRandom(data, (ULONG)size);
}
