/* lazy.S - the calls of lazy.h, for x86-64; the script `calls` writes one line for each, and includes this
 *
 *   library N, "FILE"...       what the next lines are of
 *   function N, NAME
 *   object N, NAME, BYTES
 *   end N
 *
 * With LAZY_NEEDS nothing is lazy: a module that refers to all of them, for who wants to know a program's libraries.
 */
#if defined(__has_include)
#if __has_include(<cet.h>)
#include <cet.h>
#endif
#endif
#ifndef _CET_ENDBR
#define _CET_ENDBR
#endif
    .section .note.GNU-stack, "", @progbits

#ifdef LAZY_NEEDS

    .macro library number, files:vararg
    .endm
    .macro function number, name
    .data
    .quad \name
    .endm
    .macro object number, name, bytes
    .data
    .quad \name
    .endm
    .macro end number
    .endm

#else

    .macro string text:vararg           /* leaves its address at 1b */
    .section .rodata
1:  .asciz \text
    .endm

    .macro library number, files:vararg         /* struct lazy_library, and its symbols behind it */
    string \files, ""
    .data
    .balign 8
library_\number:
    .quad first_\number, end_\number, 1b, 0
first_\number:
    .endm

    .macro function number, name
    string "\name"
    .data
2:  .quad 1b, 0, lazy_first, library_\number    /* struct lazy_symbol */
    .text
    .globl \name
    .type \name, @function
\name:
    .cfi_startproc
    _CET_ENDBR
    lea 2b(%rip), %r11
    jmp *16(%r11)
    .cfi_endproc
    .size \name, . - \name
    .endm

    .macro object number, name, bytes
    string "\name"
    .data
    .quad 1b, \bytes, \name, library_\number
    .bss
    .balign 16
    .globl \name
    .type \name, @object
    .size \name, \bytes
\name:
    .zero \bytes
    .endm

    .macro end number
    .data
end_\number:
    .endm

    .macro save register
    push \register
    .cfi_adjust_cfa_offset 8
    .endm
    .macro restore register
    pop \register
    .cfi_adjust_cfa_offset -8
    .endm

/* The first call: r11 is its struct lazy_symbol.  What may hold an argument is kept: seven integers (rax: how many
 * vectors a variable list has), eight vectors, and r10, which some languages pass.  Nine words and the return address
 * leave the stack aligned for the call. */
    .text
    .type lazy_first, @function
lazy_first:
    .cfi_startproc
    _CET_ENDBR
    .irp register, %rdi, %rsi, %rdx, %rcx, %r8, %r9, %rax, %r10, %r11
    save \register
    .endr
    sub $128, %rsp
    .cfi_adjust_cfa_offset 128
    .irp n, 0, 1, 2, 3, 4, 5, 6, 7
    movups %xmm\n, 16*\n(%rsp)
    .endr
    mov %r11, %rdi
    call lazy_load
    mov %rax, 128(%rsp)                 /* to be r11 */
    .irp n, 0, 1, 2, 3, 4, 5, 6, 7
    movups 16*\n(%rsp), %xmm\n
    .endr
    add $128, %rsp
    .cfi_adjust_cfa_offset -128
    .irp register, %r11, %r10, %rax, %r9, %r8, %rcx, %rdx, %rsi, %rdi
    restore \register
    .endr
    jmp *%r11
    .cfi_endproc
    .size lazy_first, . - lazy_first

#endif
