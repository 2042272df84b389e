// A viewer of a running session, for C#: receives every tick of `palpate explore`, on this machine or another one, by the viewer's
// protocol (docs/reference/viewer-protocol.md). It needs no library of palpate. For displays and loggers: forces on a hand are
// computed by Session, or by palpate explore itself.
//
// Lengths are mm, forces N, times s. World is +x right, +y forward, +z up, Patient LPS; Frames converts World to Unity's frame.
using System;
using System.Net.WebSockets;
using System.Text;
using System.Threading;
using System.Threading.Tasks;

namespace Palpate
{
    /// <summary>One device in a tick, in the precision of the message.</summary>
    public struct DeviceSample
    {
        public Vector TipPatientMm, ProxyPatientMm;
        public Quaternion OrientationWxyz;
        public Vector ForceN;
        public float UnclampedForceN, DepthMm;
        public Flags Flags;
        public uint Buttons, Label;
    }

    /// <summary>One tick of a session.</summary>
    public struct TickSample
    {
        public ulong Tick;
        public double TimeS;
        public uint ModelVersion;
        public Quaternion RotationWxyz;
        public DeviceSample[] Device;
    }

    /// <summary>Consecutive ticks, as a session sends them with each pose.</summary>
    public sealed class TickBundle
    {
        const int HeadBytes = 32;

        /// <summary>Number of this bundle, from 1.</summary>
        public readonly ulong Sequence;
        /// <summary>Number of ticks missing between the first and the last one received so far, because this viewer or the session was too slow.</summary>
        public readonly ulong Lost;
        public readonly TickSample[] Ticks;

        TickBundle(ulong sequence, ulong lost, TickSample[] ticks) { Sequence = sequence; Lost = lost; Ticks = ticks; }

        /// <summary>Reads a binary message; null: it is of another kind.</summary>
        public static TickBundle Parse(byte[] message, int count)
        {
            if (count < HeadBytes || Encoding.ASCII.GetString(message, 0, 4) != "PLPB") return null;
            var wire = new Wire(message, 8);
            if (wire.UInt32() != count) throw new FormatException("a bundle of another length than it says");
            var ticks = new TickSample[wire.UInt32()];
            ulong sequence = wire.UInt64(), lost = wire.UInt64();
            for (int n = 0; n < ticks.Length; ++n) ticks[n] = ReadTick(wire);
            if (wire.At != count) throw new FormatException("a bundle with more bytes than ticks");
            return new TickBundle(sequence, lost, ticks);
        }

        // in the order of the tables in docs/reference/viewer-messages.md
        static TickSample ReadTick(Wire wire)
        {
            var tick = new TickSample();
            tick.Tick = wire.UInt64();
            tick.TimeS = wire.Double();
            tick.ModelVersion = wire.UInt32();
            tick.Device = new DeviceSample[wire.UInt32()];
            tick.RotationWxyz = wire.Quaternion();
            for (int n = 0; n < tick.Device.Length; ++n) tick.Device[n] = ReadDevice(wire);
            return tick;
        }

        static DeviceSample ReadDevice(Wire wire)
        {
            var device = new DeviceSample();
            device.TipPatientMm = wire.Vector();
            device.ProxyPatientMm = wire.Vector();
            device.OrientationWxyz = wire.Quaternion();
            device.ForceN = wire.Vector();
            device.UnclampedForceN = wire.Single();
            device.DepthMm = wire.Single();
            device.Flags = (Flags)wire.UInt32();
            device.Buttons = wire.UInt32();
            device.Label = wire.UInt32();
            return device;
        }

        /// <summary>Little-endian numbers in a row, on a little-endian machine, as all of Unity's are.</summary>
        sealed class Wire
        {
            readonly byte[] bytes;
            public int At;
            public Wire(byte[] bytes, int at) { this.bytes = bytes; At = at; }
            int Advance(int count) { At += count; return At - count; }
            public uint UInt32() { return BitConverter.ToUInt32(bytes, Advance(4)); }
            public ulong UInt64() { return BitConverter.ToUInt64(bytes, Advance(8)); }
            public float Single() { return BitConverter.ToSingle(bytes, Advance(4)); }
            public double Double() { return BitConverter.ToDouble(bytes, Advance(8)); }
            public Vector Vector() { return new Vector(Single(), Single(), Single()); }
            public Quaternion Quaternion() { return new Quaternion(Single(), Single(), Single(), Single()); }
        }
    }

    /// <summary>A connection to a session. Call Receive from a thread of its own, not from Update: it waits.</summary>
    public sealed class Viewer : IDisposable
    {
        readonly ClientWebSocket socket = new ClientWebSocket();
        byte[] buffer = new byte[1 << 16];

        /// <param name="address">"ws://127.0.0.1:8480/ws", or "wss://..." of another machine</param>
        /// <param name="token">access token of the session; null: none is needed</param>
        /// <param name="bundlesEachSecond">1 to 120</param>
        public Viewer(string address, string token = null, int bundlesEachSecond = 60)
        {
            socket.Options.AddSubProtocol("palpate.v1");
            Wait(socket.ConnectAsync(new Uri(address), CancellationToken.None));
            // a token has letters and digits, or other printable characters
            string escaped = token == null ? "" : token.Replace("\\", "\\\\").Replace("\"", "\\\"");
            string hello = "{\"type\": \"hello\", \"protocol\": 3, \"ticks\": true, \"poses_hz\": " + bundlesEachSecond +
                (token == null ? "" : ", \"token\": \"" + escaped + "\"") + "}";
            var bytes = new ArraySegment<byte>(Encoding.UTF8.GetBytes(hello));
            Wait(socket.SendAsync(bytes, WebSocketMessageType.Text, true, CancellationToken.None));
        }

        /// <summary>Waits for the next bundle and skips other messages; null: the session has ended.</summary>
        public TickBundle Receive()
        {
            while (true)
            {
                int count = 0;
                WebSocketReceiveResult part;
                do
                {
                    if (count == buffer.Length) Array.Resize(ref buffer, 2 * buffer.Length);
                    var room = new ArraySegment<byte>(buffer, count, buffer.Length - count);
                    part = Result(socket.ReceiveAsync(room, CancellationToken.None));
                    if (part.MessageType == WebSocketMessageType.Close) return null;
                    count += part.Count;
                } while (!part.EndOfMessage);
                var bundle = part.MessageType == WebSocketMessageType.Binary ? TickBundle.Parse(buffer, count) : null;
                if (bundle != null) return bundle;
            }
        }

        public void Dispose() { socket.Dispose(); }

        static void Wait(Task task) { task.GetAwaiter().GetResult(); }
        static T Result<T>(Task<T> task) { return task.GetAwaiter().GetResult(); }
    }
}
