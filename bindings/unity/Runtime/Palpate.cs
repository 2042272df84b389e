// palpate for C#: Unity, Godot, mono and .NET on Linux, over the C library libpalpate.so. include/palpate.h states units, frames,
// ranges and errors of each function; the names are the same in C#'s spelling. One file, without unsafe code: add it to a project.
//
// Lengths are mm, forces N, torques N mm, times s. Frames are right-handed, World (+x right, +y forward, +z up) and Patient (LPS).
// Unity's frame is left-handed, with +y up, in metres: Frames converts.
using System;
using System.Runtime.InteropServices;
using System.Text;

namespace Palpate
{
    /// <summary>A call that palpate refused. The text states the fault, its place and the remedy.</summary>
    public sealed class PalpateException : Exception
    {
        public readonly int Status;
        public PalpateException(int status, string text) : base(text) { Status = status; }
    }

    public enum Frame { World = 0, Patient = 1 }

    public enum Method { Default = -1, Trilinear = 0, BSpline = 1, GaussianSphere = 2, SmoothSphere = 3, StoredNormals = 4, Proxy = 5 }

    [Flags]
    public enum Flags : uint
    {
        Clamped = 1 << 0, NotFinite = 1 << 1, Outside = 1 << 2, Contact = 1 << 4, Ramp = 1 << 8, Stale = 1 << 9, Jump = 1 << 10
    }

    // ---- structs of palpate.h, member by member; bindings/unity/unity_test.py compares them with the library

    [StructLayout(LayoutKind.Sequential)]
    public struct Vector
    {
        public double X, Y, Z;
        public Vector(double x, double y, double z) { X = x; Y = y; Z = z; }
        public double Length { get { return Math.Sqrt(X * X + Y * Y + Z * Z); } }
    }

    [StructLayout(LayoutKind.Sequential)]
    public struct Quaternion
    {
        public double W, X, Y, Z;
        public Quaternion(double w, double x, double y, double z) { W = w; X = x; Y = y; Z = z; }
    }

    [StructLayout(LayoutKind.Sequential)]
    public struct SixNumbers { public double N0, N1, N2, N3, N4, N5; }

    [StructLayout(LayoutKind.Sequential)]
    public struct SixIndices { public uint N0, N1, N2, N3, N4, N5; }

    [StructLayout(LayoutKind.Sequential)]
    public struct SixVectors { public Vector N0, N1, N2, N3, N4, N5; }

    /// <summary>Pose of a device (plp_pose). Make one by Session.NewPoses().</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Pose
    {
        public uint Size, Buttons;
        public Vector TipMm;
        public Quaternion OrientationWxyz;
        public double AgeS;
        public uint Status, Reserved;
    }

    /// <summary>Force and torque on the hand (plp_wrench).</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Wrench
    {
        public uint Size, Reserved;
        public Vector ForceN, TorqueNmm;
    }

    /// <summary>One tick of one device (plp_record).</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Record
    {
        public uint Size, Device;
        public ulong Tick, StateHash;
        public double TimeS, DtS;
        public uint ModelVersion;
        public Flags Flags;
        public uint Label;
        public int Method;
        public Vector TipWorldMm;
        public Quaternion OrientationWorldWxyz;
        public Vector ForceWorldN, TorqueWorldNmm, TipPatientMm, ProxyPatientMm, NormalPatient, VelocityPatientMmS;
        public double DepthMm, Field, UnclampedForceN, LimitN, EnergyMJ, DampingNSPerM;
        public SixIndices ContactLabel, ContactPart;
        public SixVectors ContactPatientMm;
        public SixNumbers ContactN;
        public SixIndices PathLabel;
        public SixNumbers PathDepthMm, PathShare;
    }

    /// <summary>Options of a session (plp_session_options). Begin with SessionOptions.Defaults().</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct SessionOptions
    {
        public uint Size, Devices;
        public int Frame, Method, Friction, Viscosity, Passivity, SolveSoftTissue;
        public double MaxForceN, MaxTorqueNmm, MaxStiffnessNPerMm, ContinuousForceN, PositionStepMm, SlewNPerS;

        public static SessionOptions Defaults()
        {
            var options = new SessionOptions();
            Native.Check(Native.plp_session_options_init(ref options, (UIntPtr)Marshal.SizeOf(typeof(SessionOptions))));
            return options;
        }
    }

    static class Native
    {
        const string Library = "palpate";

        [DllImport(Library)] internal static extern IntPtr plp_version();
        [DllImport(Library)] internal static extern IntPtr plp_last_error();
        [DllImport(Library)] internal static extern int plp_model_load(byte[] scene, byte[] segmentation, IntPtr options, out IntPtr model);
        [DllImport(Library)] internal static extern void plp_model_destroy(IntPtr model);
        [DllImport(Library)] internal static extern int plp_session_options_init(ref SessionOptions options, UIntPtr size);
        [DllImport(Library)] internal static extern int plp_pose_init(ref Pose pose, UIntPtr size);
        [DllImport(Library)] internal static extern int plp_session_create(IntPtr model, ref SessionOptions options, out IntPtr session);
        [DllImport(Library)] internal static extern void plp_session_destroy(IntPtr session);
        [DllImport(Library)] internal static extern int plp_session_tick(IntPtr session, [In] Pose[] poses, double dt_s, [In, Out] Wrench[] wrenches);
        [DllImport(Library)] internal static extern int plp_session_record(IntPtr session, UIntPtr device, ref Record record);
        [DllImport(Library)] internal static extern int plp_session_hash(IntPtr session, out ulong ticks, out ulong hash);
        [DllImport(Library)] internal static extern int plp_session_reset(IntPtr session);

        internal static void Check(int status)
        {
            if (status != 0) throw new PalpateException(status, Text(plp_last_error()));
        }

        internal static string Text(IntPtr utf8)
        {
            if (utf8 == IntPtr.Zero) return "";
            int length = 0;
            while (Marshal.ReadByte(utf8, length) != 0) ++length;
            var bytes = new byte[length];
            Marshal.Copy(utf8, bytes, 0, length);
            return Encoding.UTF8.GetString(bytes);
        }

        internal static byte[] Utf8(string text) { return text == null ? null : Encoding.UTF8.GetBytes(text + "\0"); }
    }

    public static class Library
    {
        public static string Version { get { return Native.Text(Native.plp_version()); } }
    }

    /// <summary>A segmented volume with the haptic properties of its structures; immutable.</summary>
    public sealed class Model : IDisposable
    {
        internal IntPtr Handle;
        Model(IntPtr handle) { Handle = handle; }

        /// <summary>Loads a data set ("knee-phantom:spacing=2"), a scene file or a volume.</summary>
        public static Model Load(string scene, string segmentation = null)
        {
            IntPtr handle;
            Native.Check(Native.plp_model_load(Native.Utf8(scene), Native.Utf8(segmentation), IntPtr.Zero, out handle));
            return new Model(handle);
        }

        public void Dispose()
        {
            Native.plp_model_destroy(Handle);
            Handle = IntPtr.Zero;
            GC.SuppressFinalize(this);
        }
        ~Model() { Native.plp_model_destroy(Handle); }
    }

    /// <summary>Devices that touch a model, ticked by the caller from one thread at a time. A tick allocates nothing.</summary>
    public sealed class Session : IDisposable
    {
        readonly Wrench[] wrenches;
        IntPtr handle;

        public Session(Model model, SessionOptions options)
        {
            Native.Check(Native.plp_session_create(model.Handle, ref options, out handle));
            wrenches = new Wrench[options.Devices];
            for (int n = 0; n < wrenches.Length; ++n) wrenches[n].Size = (uint)Marshal.SizeOf(typeof(Wrench));
        }

        /// <summary>A pose for each device, with the identity orientation.</summary>
        public Pose[] NewPoses()
        {
            var poses = new Pose[wrenches.Length];
            for (int n = 0; n < poses.Length; ++n)
                Native.Check(Native.plp_pose_init(ref poses[n], (UIntPtr)Marshal.SizeOf(typeof(Pose))));
            return poses;
        }

        /// <summary>Advances by one tick of dt seconds. The result is valid until the next one.</summary>
        public Wrench[] Tick(Pose[] poses, double dt)
        {
            if (poses == null || poses.Length != wrenches.Length) throw new ArgumentException("poses: give one for each device");
            Native.Check(Native.plp_session_tick(handle, poses, dt, wrenches));
            return wrenches;
        }

        /// <summary>The last tick of a device.</summary>
        public Record Last(int device)
        {
            var record = new Record { Size = (uint)Marshal.SizeOf(typeof(Record)) };
            Native.Check(Native.plp_session_record(handle, (UIntPtr)device, ref record));
            return record;
        }

        /// <summary>Hash over all ticks: equal for equal runs, in every language.</summary>
        public ulong Hash
        {
            get
            {
                ulong ticks, hash;
                Native.Check(Native.plp_session_hash(handle, out ticks, out hash));
                return hash;
            }
        }

        public void Reset() { Native.Check(Native.plp_session_reset(handle)); }

        public void Dispose()
        {
            Native.plp_session_destroy(handle);
            handle = IntPtr.Zero;
            GC.SuppressFinalize(this);
        }
        ~Session() { Native.plp_session_destroy(handle); }
    }

    /// <summary>World and Unity: x right, World's y forward is Unity's z, World's z up is Unity's y; mm and m.</summary>
    public static class Frames
    {
        public static Vector MmFromUnity(float x, float y, float z) { return new Vector(1e3 * x, 1e3 * z, 1e3 * y); }

        /// <summary>Converts a direction or force from World to Unity's axes; the unit stays.</summary>
        public static Vector ToUnity(Vector world) { return new Vector(world.X, world.Z, world.Y); }

        /// <summary>Swapping two axes mirrors the frame, so that the vector part changes its sign.</summary>
        public static Quaternion FromUnity(float x, float y, float z, float w) { return new Quaternion(w, -x, -z, -y); }
    }
}
