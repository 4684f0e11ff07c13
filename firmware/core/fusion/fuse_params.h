// SPDX-License-Identifier: MIT
// Every number of the filter, once, as a plain number whose unit ends its name. fuse*.c
// make fixed point of them at compile time (core/math/constant.h); the filter in
// doubles, tests/core/fuse_twin.c, uses them as they are. After a change `make bench`
// shows what it does to the accuracy.
//
// "VQF" is a default of Laidig and Seel 2023, table 1. "Fitted" was chosen on
// recordings and simulated motions whose truth is known
// (docs/decisions/filter.md). The others follow from data sheets or keep numbers
// in range.
#ifndef FUSE_PARAMS_H
#define FUSE_PARAMS_H

// Everything but the integration is done once in a window.
#define FUSE_WINDOW_S 0.1
#define FUSE_LOOK_S 0.01  // the interval at which the detection of rest looks

// The growth in one window of something that grows by `rate` a second; a time in
// windows and in looks, to the nearest.
#define FUSE_PER_WINDOW(rate) (FUSE_WINDOW_S * (rate))
#define FUSE_WINDOWS(seconds) ROUNDED((seconds) / FUSE_WINDOW_S)
#define FUSE_LOOKS(seconds) ROUNDED((seconds) / FUSE_LOOK_S)

// Integration and levelling.
#define FUSE_LEVEL_TAU_S 3.0        // low-pass of the specific force; VQF, tau_acc
#define FUSE_FORCE_MIN_M_S2 1.0     // below it, free fall, nothing is levelled
#define FUSE_GRAVITY_MIN_M_S2 4.9   // a mean force outside these two is not gravity:
#define FUSE_GRAVITY_MAX_M_S2 17.6  // simulated centrifuges stay within them
#define FUSE_LEVEL_SIGMA_G 0.06     // error of the force where nothing is calibrated
#define FUSE_UNSETTLED_S 10.0       // after lost motion, levelling says nothing of bias
#define FUSE_HIDDEN_WINDOWS 2       // from a clipped force on, gravity is where it was,
#define FUSE_HIDDEN_DRIFT_DPS 0.02  // by so much less sure in each,
#define FUSE_HIDDEN_MOST_DPS 0.3    // and from here on not known
#define FUSE_CLIPPED_LOST 4  // clipped samples in a window that lose the attitude
#define FUSE_INTERVAL_MAX_US 60000  // integrated between two samples, in nine steps

// Detection of rest.
#define FUSE_REST_TAU_S 0.5            // VQF, restFilterTau
#define FUSE_REST_S 1.5                // VQF, restMinT
#define FUSE_REST_RATE_DPS 2.0         // VQF, restThGyr
#define FUSE_REST_FORCE_M_S2 0.5       // VQF, restThAcc
#define FUSE_REST_RATE_MAX_RAD_S 10.0  // keeps the low-pass in range

// Gyroscope bias. A rest reads it directly, levelling corrections read it in motion.
#define FUSE_BIAS_MAX_RAD_S 3.4         // ten times what a calibration accepts
#define FUSE_BIAS_SIGMA_DPS 0.5         // before anything is known; VQF, biasSigmaInit
#define FUSE_BIAS_FOUND_SIGMA_DPS 0.01  // after the calibration at rest
#define FUSE_BIAS_WANDER_DPS2_S 1.5e-4  // growth of the variance, once warm; fitted
#define FUSE_WARMING_DPS2_S 5e-4        // what start-up adds to that; fitted
#define FUSE_WARMING_TAU_S 25.6         // time in which that addition decays
#define FUSE_REST_SIGMA_DPS 0.03  // noise of a mean rate at rest; VQF, biasSigmaRest
// Of two rests whose rates differ by more, one was a turn.
#define FUSE_REST_AGAINST_DPS 0.2
#define FUSE_REST_DOUBT 0.78         // share of a surprise's square added to the noise
#define FUSE_REST_DOUBT_MAX_DPS 4.0  // limit of the surprise in that; fitted
#define FUSE_REST_SURPRISE_MAX_RAD_S 4.0

// Gyroscope scale, an error of each axis's sensitivity.
#define FUSE_SCALE_MAX 0.08
#define FUSE_SCALE_SIGMA 0.01          // before anything is known
#define FUSE_SCALE_SIGMA_LEAST 0.0003  // calibrated: temperature changes it by so much
#define FUSE_SCALE_WANDER_S 4e-10      // growth of the variance

// What levelling corrects in motion, as a reading of bias and scale.
#define FUSE_MOTION_NOISE_DPS2_S 1.2  // noise of a correction; fitted
#define FUSE_MOTION_DRIFT_S 10.0      // more where corrections persist; fitted
#define FUSE_MOTION_DRIFT_MAX_DPS2 3.057
#define FUSE_TILTING_MAX_DPS 5.0            // of one correction
#define FUSE_DRIFT_START_DPS 0.1            // mean correction assumed at the start
#define FUSE_DRIFT_TAU_S 2.0                // averaging of corrections
#define FUSE_DRIFT_SQUARE_TAU_S 6.4         // averaging of their squares
#define FUSE_TURN_MAX 1.5                   // mean rate of a window, in 500 deg/s
#define FUSE_TURNED_SIGMA_MAX_DEG 20.0      // error of the integrated heading
#define FUSE_TURNED_STEP_MAX_DEG2 6.0       // growth of its variance in a window
#define FUSE_STROKE_DRIFT_MAX_M_S2 0.5      // between the rests around a stroke: 3 deg
#define FUSE_STROKE_NOISE_MAX_M2_S4 0.0093  // keeps the variance in range

// Delay of magnetometer readings behind the gyroscope. AK8963 data sheet, analog
// circuit characteristics: a measurement takes 7.2 ms, and at 100 Hz it is up to 10 ms
// old when it is read. Its middle is therefore 8.6 ms back, 4.7 ms more than the rate.
// Boards and their set-ups differ by 10 ms.
#define FUSE_LAG_S 0.005
#define FUSE_LAG_SIGMA_S 0.008
#define FUSE_LAG_MAX_S 0.03
#define FUSE_LAG_RATE_MAX_RAD_S 36.0  // an axis: 62.4 in all
#define FUSE_LAG_ANGLE_MAX_RAD 0.3    // an axis
#define FUSE_LAG_FIELD_MAX_UT 200.0   // an axis
#define FUSE_LAG_SLOPE_MAX_UT_S 1999.9

// Magnetometer readings.
// Mostly what is uneven in a room; fitted. At most 7.8: the noise of the farthest
// reading has 32 bits.
#define FUSE_FIELD_NOISE_UT2_S 5.5
#define FUSE_FIELD_NOISE_MAX_UT2 900.0
#define FUSE_REST_FACTOR 3          // of that at rest, where readings repeat
#define FUSE_FIELD_DRIFT_S2 810.0   // noise by a level that leans; fitted
#define FUSE_FIELD_STEP_MAX_UT 6.0  // correction by one axis of a reading
#define FUSE_FIELD_ABSENT_S 1.0     // without a reading the field is absent
#define FUSE_READING_MAX_UT 1000.0  // of an axis of a reading
#define FUSE_LEARN_S 2.0            // first readings, whose mean is the place's field
#define FUSE_HORIZONTAL_MIN_UT 1.0  // below it the field tells no heading
// Equal measurements in a row of a sensor that is dead; the noise of a good one, ten
// counts of force and four of field, never repeats so often.
#define FUSE_REPEATS_FORCE 25  // of every look at rest
#define FUSE_REPEATS_FIELD 25

// The field of the place.
#define FUSE_PLACE_MAX_UT 3600.0
#define FUSE_FIELD_MAX_UT 60.0       // where only an error of tilt or heading counts
#define FUSE_FIELD_SIGMA_MAX_UT 9.0  // of an axis
#define FUSE_FIELD_UNKNOWN_MAX_UT2 460.0  // its square on an uncalibrated probe
#define FUSE_PLACE_SIGMA_UT 1.5           // of the first mean at rest
#define FUSE_PLACE_MOVING_SIGMA_UT 3.0    // in addition, if there was no rest
#define FUSE_PLACE_WANDER_UT2_S 0.002     // growth of the variance
#define FUSE_PLACE_SPREAD_MAX_UT2 60.0    // limit to what heading errors add to it

// What can't be the field of the Earth, which is 22 to 67 uT (IGRF-13), or isn't that
// in which the probe was calibrated.
#define FUSE_EARTH_MIN_UT 18.0
#define FUSE_EARTH_MAX_UT 75.0
#define FUSE_UNLIKE_PART 5  // a field is unlike, whose components are off by more
#define FUSE_PLAIN_S 2.0    // of plain readings: learn the local field again
#define FUSE_OWN_IMPOSSIBLE_UT 50.0  // of the own field, where no calibration told it
#define FUSE_ELSEWHERE_SIGMA_UT 2.0  // own field known to it, and small: another place

// The probe's own field: hard iron that a calibration left, or a magnet put on it.
#define FUSE_OWN_MAX_UT 400.0
#define FUSE_OWN_KNOWN_SIGMA_UT 0.790569  // at least, of a calibrated probe
#define FUSE_OWN_UNKNOWN_SIGMA_UT 21.0    // of an uncalibrated one
#define FUSE_OWN_GOOD_SIGMA_UT 1.0  // up to it the probe counts as calibrated well
#define FUSE_OWN_CALIBRATED_SIGMA_UT 2.0  // up to it no magnet is expected,
#define FUSE_OWN_NEAR_UT 4.0              // as long as no axis seems larger than this:
#define FUSE_OWN_DOUBT_UT 9.5             // then it is read as 0 with this sigma
#define FUSE_OWN_WANDER_UT2_S 1.9e-5      // growth of the variance: (0.26 uT)^2 an hour
#define FUSE_OWN_WANDER_ASTRAY_UT2_S 16.0  // the same while readings say it has changed
#define FUSE_OWN_KEPT_SIGMA_UT 3.0         // stored with it: 2 uT, and soft iron
#define FUSE_OWN_WARMTH_UT_K 0.01726  // sigma, a kelvin from its calibration; assumed
#define FUSE_OWN_SURE_SIGMA_UT 2.0    // it is stored only if known this well
#define FUSE_OWN_SURPRISE_MAX_UT 6.0  // and readings fit: soft iron of 4 % does

// Readings that surprise: their distance from the expected field.
#define FUSE_SURPRISE_UT 3.0       // its unit
#define FUSE_SURPRISE_MAX_UT 90.0  // of an axis
#define FUSE_SURPRISE_TAU_S 0.4    // averaging
#define FUSE_TURNED_SURPRISE 8.0   // squared units from which the heading may be wrong
#define FUSE_ASTRAY_TAU_S 1.6      // averaging of whether a reading is strange
#define FUSE_ASTRAY_LENGTH_UT 2.0  // strange: its length is off by more than this
#define FUSE_ASTRAY_SHARE 0.5      // of strange readings: the own field has changed

// A reading across the horizontal field also tells how far the integrated heading is
// off.
#define FUSE_TURNING_SHARE 0.7        // of the field's noise that counts there; fitted
#define FUSE_TURNING_FAR 25.0         // limit of the squared surprise, in units
#define FUSE_TURNING_DRIFT_S2 8100.0  // noise by a level that leans; fitted
#define FUSE_TURNING_LEANING_MAX_UT2 506.25
#define FUSE_TURNING_FIELD_MAX_UT 50.0
#define FUSE_ACROSS_TAU_S 3.2  // averaging of what readings are off, with its sign
#define FUSE_ACROSS_MAX_UT 10.0

// A drifting gyroscope shows across the field only, a bent room along it, too: what the
// square across is more than that along, averaged over 25.6 s in motion, but not while
// levelling corrects more than this, lets the place wander by 1 / 12.8 s.
#define FUSE_DRIFTING_LEVEL_DPS 0.3
#define FUSE_DRIFTING_TAU_S 25.6
#define FUSE_DRIFTING_WANDER_S 12.8

// Growth of the heading's variance.
#define FUSE_HEADING_WANDER_DEG2_S 0.025
#define FUSE_HEADING_WANDER_ALONE_DEG2_S 0.3    // without readings
#define FUSE_HEADING_WANDER_TURNED_DEG2_S 40.0  // while readings say that it is wrong

// The stated errors; fitted (docs/motions.md).
#define FUSE_TILT_FLOOR_DEG 0.38
#define FUSE_TILT_DRIFT_S 10.44  // factor of the mean levelling correction
#define FUSE_HEADING_FLOOR_DEG 0.6
#define FUSE_HEADING_DRIFT_S 2.45    // factor of that correction, by the vertical field
#define FUSE_HEADING_ACROSS 1.6      // factor of the square of what lasts across
#define FUSE_HEADING_ASTRAY_UT2 4.0  // where all readings are strange
#define FUSE_HEADING_WORST 1.7       // sigmas by which the field may be shorter
#define FUSE_COVARIANCE_SHARE 0.275  // of the field's covariance, on a calibrated probe
#define FUSE_UNCALIBRATED_SIGMA_UT 1.5  // what soft iron adds on another
#define FUSE_LEVEL_SHARE                                                               \
    3  // divides the level's variance: most looks like an own field
#define FUSE_HEADING_FREE_DEG 30.0  // above it no heading is stated, nor above this
#define FUSE_HEADING_FREE_UNKNOWN_DEG 22.0  // where no calibration told the own field

#endif
