! modald.f90 - modald from Fortran: the calls of modald_stream.h by iso_c_binding
!
!     use modald
!     type(modald_stream) :: s
!     s = modald_open('rig7', 3, dt)          ! before the loop
!        call modald_push(s, y)               ! in it; real32 and real64
!     call modald_close(s)                    ! after it
!
! Without MODALD_URL in the environment every call does nothing.  Blanks at the end of a name are
! trimmed.
module modald
    use, intrinsic :: iso_c_binding
    use, intrinsic :: iso_fortran_env, only: real32, real64
    implicit none
    private
    public :: modald_stream, modald_open, modald_push, modald_push_at, modald_seek, modald_window
    public :: modald_verdict, modald_estimate, modald_get_estimate
    public :: modald_close, modald_close_all, modald_abandon
    public :: modald_unknown, modald_stable, modald_unstable, modald_undecided

    integer, parameter :: modald_unknown = 0, modald_stable = 1, modald_unstable = 2, &
                          modald_undecided = 3

    type :: modald_stream
        private
        type(c_ptr) :: handle = c_null_ptr
    end type

    type, bind(C) :: modald_estimate
        real(c_double) :: frequency_hz, frequency_std
        real(c_double) :: damping_ratio, damping_std
        real(c_double) :: sample
    end type

    interface modald_open
        module procedure open_real64, open_real32
    end interface
    interface modald_push
        module procedure push_real64, push_real32
    end interface

    interface
        function c_open(name, channels, dt) bind(C, name='modald_open') result(s)
            import :: c_ptr, c_char, c_int, c_double
            character(kind=c_char), intent(in) :: name(*)
            integer(c_int), value :: channels
            real(c_double), value :: dt
            type(c_ptr) :: s
        end function
        subroutine c_push(s, y) bind(C, name='modald_push')
            import :: c_ptr, c_double
            type(c_ptr), value :: s
            real(c_double), intent(in) :: y(*)
        end subroutine
        subroutine c_push_float(s, y) bind(C, name='modald_push_float')
            import :: c_ptr, c_float
            type(c_ptr), value :: s
            real(c_float), intent(in) :: y(*)
        end subroutine
        subroutine c_push_at(s, t, y) bind(C, name='modald_push_at')
            import :: c_ptr, c_double
            type(c_ptr), value :: s
            real(c_double), value :: t
            real(c_double), intent(in) :: y(*)
        end subroutine
        subroutine c_seek(s, index) bind(C, name='modald_seek')
            import :: c_ptr, c_double
            type(c_ptr), value :: s
            real(c_double), value :: index
        end subroutine
        subroutine c_window(s, samples, hop, options) bind(C, name='modald_window')
            import :: c_ptr, c_long
            type(c_ptr), value :: s
            integer(c_long), value :: samples, hop
            type(c_ptr), value :: options
        end subroutine
        function c_verdict(s) bind(C, name='modald_verdict') result(v)
            import :: c_ptr, c_int
            type(c_ptr), value :: s
            integer(c_int) :: v
        end function
        function c_get_estimate(s, out) bind(C, name='modald_get_estimate') result(known)
            import :: c_ptr, c_int, modald_estimate
            type(c_ptr), value :: s
            type(modald_estimate), intent(out) :: out
            integer(c_int) :: known
        end function
        subroutine c_close(s) bind(C, name='modald_close')
            import :: c_ptr
            type(c_ptr), value :: s
        end subroutine
        subroutine c_close_all(streams, count) bind(C, name='modald_close_all')
            import :: c_ptr, c_size_t
            type(c_ptr), intent(in) :: streams(*)
            integer(c_size_t), value :: count
        end subroutine
        subroutine c_abandon(s) bind(C, name='modald_abandon')
            import :: c_ptr
            type(c_ptr), value :: s
        end subroutine
    end interface

contains

    function open_real64(name, channels, dt) result(s)
        character(*), intent(in) :: name
        integer, intent(in) :: channels
        real(real64), intent(in) :: dt
        type(modald_stream) :: s
        character(kind=c_char) :: text(len_trim(name) + 1)
        integer :: i

        do i = 1, len_trim(name)
            text(i) = name(i:i)
        end do
        text(len_trim(name) + 1) = c_null_char
        s%handle = c_open(text, int(channels, c_int), real(dt, c_double))
    end function

    function open_real32(name, channels, dt) result(s)
        character(*), intent(in) :: name
        integer, intent(in) :: channels
        real(real32), intent(in) :: dt
        type(modald_stream) :: s

        s = open_real64(name, channels, real(dt, real64))
    end function

    subroutine push_real64(s, y)
        type(modald_stream), intent(in) :: s
        real(real64), intent(in) :: y(*)
        call c_push(s%handle, y)
    end subroutine

    subroutine push_real32(s, y)
        type(modald_stream), intent(in) :: s
        real(real32), intent(in) :: y(*)
        call c_push_float(s%handle, y)
    end subroutine

    subroutine modald_push_at(s, t, y)
        type(modald_stream), intent(in) :: s
        real(real64), intent(in) :: t, y(*)
        call c_push_at(s%handle, t, y)
    end subroutine

    subroutine modald_seek(s, index)
        type(modald_stream), intent(in) :: s
        real(real64), intent(in) :: index
        call c_seek(s%handle, index)
    end subroutine

    subroutine modald_window(s, samples, hop)
        type(modald_stream), intent(in) :: s
        integer, intent(in) :: samples, hop
        call c_window(s%handle, int(samples, c_long), int(hop, c_long), c_null_ptr)
    end subroutine

    integer function modald_verdict(s)
        type(modald_stream), intent(in) :: s
        modald_verdict = c_verdict(s%handle)
    end function

    logical function modald_get_estimate(s, out)
        type(modald_stream), intent(in) :: s
        type(modald_estimate), intent(out) :: out
        modald_get_estimate = c_get_estimate(s%handle, out) /= 0
    end function

    subroutine modald_close(s)
        type(modald_stream), intent(inout) :: s
        call c_close(s%handle)
        s%handle = c_null_ptr
    end subroutine

    subroutine modald_close_all(streams)
        type(modald_stream), intent(inout) :: streams(:)
        type(c_ptr) :: handles(size(streams))
        integer :: i
        do i = 1, size(streams)
            handles(i) = streams(i)%handle
            streams(i)%handle = c_null_ptr
        end do
        call c_close_all(handles, int(size(handles), c_size_t))
    end subroutine

    subroutine modald_abandon(s)
        type(modald_stream), intent(inout) :: s
        call c_abandon(s%handle)
        s%handle = c_null_ptr
    end subroutine
end module modald
