#!/usr/bin/env python3
"""Makes the excerpts in this folder and the numbers that independent readers find in them (expected.toml).

usage: make.py REAL_DATA_FOLDER   (needs pyulog and pymavlink; nothing of this project)

usdlog is read with `struct` as its makers document it, ULog with pyulog, DataFlash with pymavlink. Conversions to the canonical
columns are written out here by hand: deg/s to rad/s, g to m/s2, forward-left-up to forward-right-down.
"""
import math, struct, sys, zlib
import numpy as np
from pyulog import ULog
from pymavlink import DFReader

real = sys.argv[1]
G = 9.80665
out = []

def table(name, columns):
    out.append(f'[{name}]')
    for column, values in columns.items():
        v = np.asarray(values, dtype=float)
        out.append(f'{column} = {{ count = {len(v)}, mean = {v.mean()!r}, first = {v[0]!r}, last = {v[-1]!r} }}'.replace('np.float64(', '').replace(')', ''))
    out.append('')

def usd_header(b):
    version, events = struct.unpack_from('<HH', b, 1)
    o, types = 5, {}
    for _ in range(events):
        (i,) = struct.unpack_from('<H', b, o); o += 2
        e = b.index(b'\0', o); name = b[o:e].decode(); o = e + 1
        (n,) = struct.unpack_from('<H', b, o); o += 2
        variables = []
        for _ in range(n):
            e = b.index(b'\0', o); variables.append(b[o:e].decode()); o = e + 1
        types[i] = (name, [v[:-3] for v in variables], '<' + ''.join(v[-2] for v in variables))
    return version, types, o

def usd_records(b, types, o, end):
    while o < end:
        i, t = struct.unpack_from('<HQ', b, o)
        name, names, code = types[i]
        size = struct.calcsize(code)
        yield o, o + 10 + size, name, t, dict(zip(names, struct.unpack_from(code, b, o + 10)))
        o += 10 + size

def usd_excerpt(source, target, first_s, last_s):
    b = open(source, 'rb').read()
    _, types, o = usd_header(b)
    body, rows = b'', []
    begin = None
    for start, end, name, t, values in usd_records(b, types, o, len(b) - 4):
        begin = t if begin is None else begin
        if first_s <= (t - begin) * 1e-6 <= last_s:
            body += b[start:end]
            if name == 'fixedFrequency':
                rows.append((t * 1e-6, values))
    whole = b[:o] + body
    open(target, 'wb').write(whole + struct.pack('<I', zlib.crc32(whole)))
    return rows

rows = usd_excerpt(f'{real}/arpl_crazyflie_sysid/log10', 'crazyflie-sysid.usdlog', 30.0, 30.8)
of = lambda name, factor: [factor * r[1][name] for r in rows]
deg = math.pi / 180
table('crazyflie-sysid', {
    'time_s': [r[0] - rows[0][0] for r in rows],
    'roll_rate_rad_s': of('gyro.x', deg), 'pitch_rate_rad_s': of('gyro.y', -deg), 'yaw_rate_rad_s': of('gyro.z', -deg),
    'accel_x_m_s2': of('acc.x', G), 'accel_y_m_s2': of('acc.y', -G), 'accel_z_m_s2': of('acc.z', -G),
    'duty_1': of('motor.m1', 1 / 65535), 'duty_4': of('motor.m4', 1 / 65535)})

rows = usd_excerpt(f'{real}/crazypad_e8/motor_data/normal_flight/E8_log00', 'crazypad-e8.usdlog', 4.0, 8.0)
of = lambda name, factor: [factor * r[1][name] for r in rows]
table('crazypad-e8', {
    'time_s': [r[0] - rows[0][0] for r in rows],
    'position_north_m': of('stateEstimate.x', 1), 'position_east_m': of('stateEstimate.y', -1), 'position_down_m': of('stateEstimate.z', -1),
    'yaw_rad': of('stateEstimate.yaw', -deg), 'duty_3': of('pwm.m3_pwm', 1 / 65535), 'battery_voltage_v': of('pm.vbatMV', 1e-3)})

b = open(f'{real}/pyulog_parser_samples/sample_log_small.ulg', 'rb').read()[:150000]
open('px4-on-the-ground.ulg', 'wb').write(b)
log = ULog('px4-on-the-ground.ulg')
topic = lambda name: next(d.data for d in log.data_list if d.name == name and d.multi_id == 0)
rates, accel = topic('vehicle_angular_velocity'), topic('sensor_combined')
time = rates['timestamp'] * 1e-6
table('px4-on-the-ground', {
    'time_s': time - time[0], 'roll_rate_rad_s': rates['xyz[0]'], 'pitch_rate_rad_s': rates['xyz[1]'], 'yaw_rate_rad_s': rates['xyz[2]']})

# A DataFlash log of our own, so that no GPL data are needed here: types, scales, two instances, a bad stretch.
def fmt(kind, length, name, form, labels):
    return struct.pack('<3B', 0xA3, 0x95, 128) + struct.pack('<BB4s16s64s', kind, length, name.encode(), form.encode(), labels.encode())
b = fmt(128, 89, 'FMT', 'BBnNZ', 'Type,Length,Name,Format,Columns')
b += fmt(1, 3 + 8 + 6 * 4 + 1, 'IMU', 'QBffffff', 'TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ')
b += fmt(2, 3 + 8 + 8, 'ATT', 'QccCH', 'TimeUS,Roll,Pitch,Yaw,Err')
b += fmt(3, 3 + 8 + 8, 'BAT', 'Qff', 'TimeUS,Volt,Curr')
b += fmt(4, 3 + 8 + 8, 'RCOU', 'QHHHH', 'TimeUS,C1,C2,C3,C4')
b += fmt(5, 3 + 8 + 16 + 4, 'PARM', 'QNf', 'TimeUS,Name,Value')
head = lambda kind: struct.pack('<3B', 0xA3, 0x95, kind)
b += head(5) + struct.pack('<Q16sf', 1, b'MOT_PWM_MIN', 1100.0) + head(5) + struct.pack('<Q16sf', 2, b'MOT_PWM_MAX', 1900.0)
for k in range(600):
    us = 1_000_000 + 5000 * k
    w = 0.02 * k
    for instance in (0, 1):
        b += head(1) + struct.pack('<QBffffff', us, instance, 0.3 * math.cos(w) + instance, 0.2 * math.sin(w), 0.1, 0.4, -0.3, -9.8 + 0.5 * math.sin(3 * w))
    if k % 4 == 0:
        b += head(2) + struct.pack('<QhhHH', us + 100, int(500 * math.sin(w)), int(-700 * math.cos(w)), 9000 + k, 0)
    if k == 300:
        b += b'\x00\xa3\x95\xfe garbage \xa3'
    if k % 50 == 0:
        b += head(3) + struct.pack('<Qff', us + 200, 12.6 - 0.001 * k, 15.0)
    b += head(4) + struct.pack('<QHHHH', us + 300, 1500, 1100 + k, 1900, 1300)
open('made-up.bin', 'wb').write(b)
log = DFReader.DFReader_binary('made-up.bin')
gathered = {}
while (m := log.recv_msg()) is not None:
    if m.get_type() == 'IMU' and m.I == 0 or m.get_type() in ('ATT', 'BAT'):
        for name in m.get_fieldnames():
            gathered.setdefault(f'{m.get_type()}.{name}', []).append(getattr(m, name))
imu = [t * 1e-6 for t in gathered['IMU.TimeUS']]
at = lambda kind, name: np.interp(imu, [t * 1e-6 for t in gathered[f'{kind}.TimeUS']], gathered[f'{kind}.{name}'], left=np.nan, right=np.nan)
# Only rows between two ATT and two BAT messages have a value.
inside = lambda v: v[~np.isnan(v)]
table('made-up', {
    'time_s': [t - imu[0] for t in imu], 'roll_rate_rad_s': gathered['IMU.GyrX'], 'accel_z_m_s2': gathered['IMU.AccZ'],
    'roll_rad': inside(at('ATT', 'Roll')) * deg, 'pitch_rad': inside(at('ATT', 'Pitch')) * deg, 'battery_voltage_v': inside(at('BAT', 'Volt'))})
open('expected.toml', 'w').write('# Written by make.py with readers that are not this project\'s.\n\n' + '\n'.join(out))
