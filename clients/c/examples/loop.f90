! loop.f90 - a time-stepping loop in Fortran with the three lines of modald.f90
!
! x'' + c x' + k x = 0, x(0) = 1, by the exact step of the damped oscillator; arguments: the
! stream's name, the steps (2000).
program loop
    use, intrinsic :: iso_fortran_env, only: real64, int64
    use modald
    implicit none
    real(real64), parameter :: k = 3.9d4, c = 1.7d0, dt = 1d-3
    type(modald_stream) :: s
    character(128) :: name, count
    real(real64) :: y(2), w, d
    integer :: i, steps

    call get_command_argument(1, name)
    if (len_trim(name) == 0) name = 'fortran'
    steps = 2000
    call get_command_argument(2, count)
    if (len_trim(count) > 0) read (count, *) steps
    d = c / 2
    w = sqrt(k - d**2)
    s = modald_open(name, 2, dt)
    do i = 0, steps - 1
        y(1) = exp(-d * i * dt) * (cos(w * i * dt) + d / w * sin(w * i * dt))
        y(2) = -exp(-d * i * dt) * k / w * sin(w * i * dt)
        call modald_push(s, y)
        if (modald_verdict(s) == modald_unstable) exit
    end do
    call modald_close(s)
    print '(a,i0)', 'steps ', i
end program loop
